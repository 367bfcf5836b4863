// Finds images by the names that people write into text files.
#pragma once

#include <cstddef>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace rilievo::io {

/// Knows images by their name relative to the image folder, and by the file's name alone where only one has it.
class ImageNames {
 public:
  explicit ImageNames(std::span<const std::string> names);

  /// Indices of the images that `text` may mean: one when it is the whole name, none when it is no image's.
  std::vector<std::size_t> Find(std::string_view text) const;

 private:
  std::map<std::string, std::size_t, std::less<>> by_name_;
  std::map<std::string, std::vector<std::size_t>, std::less<>> by_base_name_;
};

}  // namespace rilievo::io
