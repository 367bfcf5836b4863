// Masks: which pixels of an image are used.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "block/image.h"
#include "block/pixels.h"

namespace rilievo::images {

/// The files below a folder of masks, found by the names of images (docs/formats/masks.md).
class MaskFolder {
 public:
  /// Throws Error when it is no folder, cannot be read or holds no image file.
  explicit MaskFolder(const std::filesystem::path& folder);
  /// The mask of an image, by path relative to the folder: the same name; else the name with an ending more
  /// ("a.jpg.png"); else the same name with another ending ("a.png" for "a.jpg"). None when there is none. Throws
  /// Error when two files fit equally well.
  std::optional<std::string> Find(std::string_view image_name) const;
  std::size_t size() const { return count_; }

 private:
  std::filesystem::path folder_;
  std::size_t count_ = 0;
  std::map<std::string, std::vector<std::string>, std::less<>> by_stem_;  ///< names by path without the last ending
};

/// Looks at the mask's header and digests it. Throws Error for a file that is no 8-bit image of the size of `image`.
MaskFile InspectMask(const std::filesystem::path& folder, const std::string& name, const Image& image);

/// A byte a pixel, 128 and more = use; colour counts by its grey. Throws Error naming the mask when it cannot be
/// decoded to the size of `image`.
std::vector<std::uint8_t> LoadMask(const PixelSource& masks, const MaskFile& mask, const Image& image);

}  // namespace rilievo::images
