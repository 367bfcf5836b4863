// Finds photographs that are in the folder twice.
#include "block/io/duplicate_images.h"

#include <map>
#include <string>
#include <utility>

namespace rilievo::io {

void QuarantineDuplicates(std::vector<Image>& images, std::vector<QuarantinedImage>& quarantined) {
  std::map<Sha256Digest, std::string> first_name;
  std::vector<Image> kept;
  for (Image& image : images) {
    const auto [first, is_new] = first_name.emplace(image.content, image.name);
    if (is_new)
      kept.push_back(std::move(image));
    else
      quarantined.push_back({std::move(image.name), "same file as " + first->second});
  }
  images = std::move(kept);
}

}  // namespace rilievo::io
