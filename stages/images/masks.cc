// Finds, inspects and decodes masks.
#include "stages/images/masks.h"

#include <algorithm>
#include <utility>

#include "base/error.h"
#include "block/io/image_folder.h"
#include "block/io/image_header.h"
#include "stages/images/decode.h"

namespace rilievo::images {
namespace {

namespace fs = std::filesystem;

std::string WithoutEnding(std::string_view name) { return fs::path(name).replace_extension().generic_string(); }

std::string SizeText(const Image& image) {
  return std::to_string(image.width_px) + " x " + std::to_string(image.height_px) + " px";
}

}  // namespace

MaskFolder::MaskFolder(const fs::path& folder) : folder_(folder) {
  std::error_code failed;
  if (!fs::is_directory(folder, failed))
    throw Error(ErrorCode::kNotFound, folder.string(), "there is no such folder of masks", "--masks takes a folder");
  for (const std::string& name : io::FindImages(folder).names) {
    by_stem_[WithoutEnding(name)].push_back(name);
    ++count_;
  }
}

std::optional<std::string> MaskFolder::Find(std::string_view image_name) const {
  const auto with_stem = [&](std::string_view stem) {
    const auto found = by_stem_.find(stem);
    return found == by_stem_.end() ? std::vector<std::string>{} : found->second;
  };
  const auto only = [&](const std::vector<std::string>& names) {
    if (names.size() > 1)
      throw Error(ErrorCode::kInvalidInput, folder_.string(),
                  names[0] + " and " + names[1] + " may both be the mask of " + std::string(image_name),
                  "keep one of them");
    return names.front();
  };
  const std::vector<std::string> same_stem = with_stem(WithoutEnding(image_name)), longer = with_stem(image_name);
  if (std::find(same_stem.begin(), same_stem.end(), image_name) != same_stem.end()) return std::string(image_name);
  if (!longer.empty()) return only(longer);
  if (!same_stem.empty()) return only(same_stem);
  return std::nullopt;
}

MaskFile InspectMask(const fs::path& folder, const std::string& name, const Image& image) {
  const Image header = io::ReadImageHeader(folder, name);
  const std::string path = (folder / name).string();
  if (header.width_px != image.width_px || header.height_px != image.height_px)
    throw Error(ErrorCode::kInvalidInput, path,
                "is " + SizeText(header) + ", and its image " + image.name + " is " + SizeText(image),
                "a mask has the size of its image as stored; EXIF orientation is not applied");
  if (header.bits_per_sample != 8)
    throw Error(ErrorCode::kUnsupported, path, "is a mask of 16 bits a sample", "save it as 8-bit grey");
  return {name, header.content, FolderPixelSource(folder).LoadPeakBytes(header, false)};
}

std::vector<std::uint8_t> LoadMask(const PixelSource& masks, const MaskFile& mask, const Image& image) {
  GreyImage pixels;
  try {
    pixels = masks.Load(mask.name, false);
  } catch (const Error& error) {
    throw Error(error.code(), error.path(), "mask " + mask.name + ": " + error.message(), error.hint());
  }
  if (pixels.width_px != image.width_px || pixels.height_px != image.height_px || pixels.Is16Bit())
    throw Error(ErrorCode::kInvalidInput, mask.name, "mask " + mask.name + ": its header and its pixels disagree",
                "save it again");
  return std::move(pixels.u8);
}

}  // namespace rilievo::images
