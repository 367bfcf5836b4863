// Finds the photographs of a folder and puts them in order.
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "block/image.h"

namespace rilievo::io {

/// `names`: relative to the folder, '/' separated, in natural order. `ignored`: files that look like photographs and
/// cannot be used (broken links, names that are not UTF-8 or hold control characters, raw formats) and folders that
/// were not searched (unreadable, links), with the reason; their names are Printable.
struct FoundImages {
  std::vector<std::string> names;
  std::vector<QuarantinedImage> ignored;
};

/// Total order in which runs of digits compare as numbers: IMG_2 < IMG_10. Equal numbers (1, 01) fall back to the
/// bytes.
bool NaturalLess(std::string_view a, std::string_view b);

/// Searches `folder` and its subfolders for .jpg .jpeg .png .tif .tiff (any case). Hidden files and folders and
/// everything that is not a file is skipped; other files are silently no images; links to files are followed. Links to
/// folders below `folder` are not followed (they may lead in circles) and subfolders that cannot be read do not end the
/// search: both are `ignored`. Throws Error when the folder is missing, is a file, cannot be read or has no image.
FoundImages FindImages(const std::filesystem::path& folder);

/// The images in the order of a text file (docs/formats/order.md): one name a line, full or base name; '#' starts a
/// comment line; a bare count may come first. Throws Error with the line for unknown, ambiguous and repeated names, and
/// for an empty list.
std::vector<std::string> ReadOrderFile(const std::filesystem::path& path, std::span<const std::string> names);

/// The `names` that an order leaves out, in natural order, with that reason.
std::vector<QuarantinedImage> LeftOutByOrder(std::span<const std::string> names, std::span<const std::string> order);

}  // namespace rilievo::io
