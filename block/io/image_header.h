// Reads what the header of an image file says: size, sample format, EXIF.
#pragma once

#include <filesystem>
#include <string>

#include "block/image.h"

namespace rilievo::io {

/// Size, channels (1..4, alpha included), bits a sample (8 or 16 as decoded), EXIF and SHA-256 of the file's bytes; no
/// pixel is decoded. `id` and `camera_id` stay unset. The format is told by content, not by extension. Damaged or
/// absent EXIF leaves `exif` empty: it is no reason to lose a photograph. Texts of EXIF are UTF-8 without controls.
/// Throws Error(kNotFound / kUnreadable / kInvalidInput / kUnsupported) with the reason: empty file, cut off inside the
/// header, no JPEG, PNG or TIFF, implausible size, a file too short for its size, sample format that is not read. Reads
/// the file once (for its hash). May run in several tasks at once.
Image ReadImageHeader(const std::filesystem::path& folder, const std::string& name);

}  // namespace rilievo::io
