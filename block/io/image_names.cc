// Whole names first, then the names of files.
#include "block/io/image_names.h"

#include <filesystem>

namespace rilievo::io {

ImageNames::ImageNames(std::span<const std::string> names) {
  for (std::size_t i = 0; i < names.size(); ++i) {
    by_name_.emplace(names[i], i);
    by_base_name_[std::filesystem::path(names[i]).filename().string()].push_back(i);
  }
}

std::vector<std::size_t> ImageNames::Find(std::string_view text) const {
  if (const auto whole = by_name_.find(text); whole != by_name_.end()) return {whole->second};
  if (const auto base = by_base_name_.find(text); base != by_base_name_.end()) return base->second;
  return {};
}

}  // namespace rilievo::io
