// Reads what the header of an image file says: size, sample format, EXIF.
#include "block/io/image_header.h"

#include <cmath>
#include <exiv2/exiv2.hpp>
#include <string_view>

#include "base/error.h"
#include "block/io/image_format.h"
#include "block/io/utf8.h"

namespace rilievo::io {
namespace {

/// Exiv2 has two things that are set once a process: its log, silenced here (reasons go into Error), and its XMP
/// toolkit, whose start is not safe in two tasks at once; PNG and TIFF files may carry XMP, so it is started before the
/// first file.
bool PrepareExiv2() {
  Exiv2::LogMsg::setLevel(Exiv2::LogMsg::mute);
  return Exiv2::XmpParser::initialize();
}

const Exiv2::Exifdatum* Find(const Exiv2::ExifData& data, const char* key) {
  const auto found = data.findKey(Exiv2::ExifKey(key));
  return found == data.end() || found->count() == 0 ? nullptr : &*found;
}

/// Cameras write any bytes: a Latin-1 name must not break a report.
std::string TextOf(const Exiv2::ExifData& data, const char* key) {
  const auto* datum = Find(data, key);
  if (!datum) return {};
  const std::string text = datum->toString();
  return CleanText(std::string_view(text).substr(0, text.find('\0')));
}

/// A finite number; 0 when absent or of denominator 0.
double NumberOf(const Exiv2::ExifData& data, const char* key, long index = 0) {
  const auto* datum = Find(data, key);
  if (!datum || datum->count() <= index) return 0;
  const Exiv2::Rational rational = datum->toRational(index);
  if (rational.second == 0) return 0;
  return static_cast<double>(rational.first) / rational.second;
}

/// Degrees, minutes and seconds as signed degrees; none when absent or out of range.
std::optional<double> AngleOf(const Exiv2::ExifData& data, const char* key, const char* reference_key, char negative,
                              double limit_deg) {
  const auto* datum = Find(data, key);
  if (!datum || datum->count() < 3) return std::nullopt;
  for (long i = 0; i < 3; ++i)
    if (i == 0 && datum->toRational(i).second == 0) return std::nullopt;
  const double angle_deg = NumberOf(data, key, 0) + NumberOf(data, key, 1) / 60 + NumberOf(data, key, 2) / 3600;
  if (!(angle_deg >= 0 && angle_deg <= limit_deg)) return std::nullopt;
  return TextOf(data, reference_key).starts_with(negative) ? -angle_deg : angle_deg;
}

std::optional<std::array<double, 3>> GnssOf(const Exiv2::ExifData& data) {
  const auto latitude = AngleOf(data, "Exif.GPSInfo.GPSLatitude", "Exif.GPSInfo.GPSLatitudeRef", 'S', 90);
  const auto longitude = AngleOf(data, "Exif.GPSInfo.GPSLongitude", "Exif.GPSInfo.GPSLongitudeRef", 'W', 180);
  if (!latitude || !longitude) return std::nullopt;
  double altitude_m = NumberOf(data, "Exif.GPSInfo.GPSAltitude");
  const auto* reference = Find(data, "Exif.GPSInfo.GPSAltitudeRef");
  if (reference && reference->toLong() == 1) altitude_m = -altitude_m;  // below sea level
  return std::array<double, 3>{*latitude, *longitude, altitude_m};
}

/// FocalPlaneResolutionUnit: 2 = inch, 3 = cm, 4 = mm, 5 = micrometre; 1 and absent mean inch in practice.
double FocalPlaneResolutionPerMm(const Exiv2::ExifData& data) {
  const double resolution = NumberOf(data, "Exif.Photo.FocalPlaneXResolution");
  const auto* unit = Find(data, "Exif.Photo.FocalPlaneResolutionUnit");
  const long code = unit ? unit->toLong() : 2;
  const double unit_mm = code == 3 ? 10.0 : code == 4 ? 1.0 : code == 5 ? 0.001 : 25.4;
  return std::max(0.0, resolution / unit_mm);
}

ExifData Extract(const Exiv2::ExifData& data) {
  ExifData exif;
  if (const auto* orientation = Find(data, "Exif.Image.Orientation")) {
    const long value = orientation->toLong();
    if (value >= 1 && value <= 8) exif.orientation = static_cast<int>(value);
  }
  exif.focal_mm = std::max(0.0, NumberOf(data, "Exif.Photo.FocalLength"));
  exif.focal_35mm_mm = std::max(0.0, NumberOf(data, "Exif.Photo.FocalLengthIn35mmFilm"));
  exif.make = TextOf(data, "Exif.Image.Make");
  exif.model = TextOf(data, "Exif.Image.Model");
  exif.serial = TextOf(data, "Exif.Photo.BodySerialNumber");
  if (exif.serial.empty())
    if (const auto maker = Exiv2::serialNumber(data); maker != data.end()) exif.serial = CleanText(maker->print(&data));
  exif.lens = TextOf(data, "Exif.Photo.LensModel");
  if (exif.lens.empty())
    if (const auto maker = Exiv2::lensName(data); maker != data.end()) exif.lens = CleanText(maker->print(&data));
  exif.date_time = TextOf(data, "Exif.Photo.DateTimeOriginal");
  exif.gnss = GnssOf(data);
  exif.focal_plane_x_res_per_mm = FocalPlaneResolutionPerMm(data);
  return exif;
}

ExifData ReadExif(const std::filesystem::path& path, const FormatHeader& header) {
  [[maybe_unused]] static const bool prepared = PrepareExiv2();
  try {
    if (header.format != ImageFormat::kJpeg) {
      const auto image = Exiv2::ImageFactory::open(path.string());
      image->readMetadata();
      return Extract(image->exifData());
    }
    if (header.exif.empty()) return {};
    Exiv2::ExifData data;
    Exiv2::ExifParser::decode(data, header.exif.data(), static_cast<std::uint32_t>(header.exif.size()));
    return Extract(data);
  } catch (const Exiv2::AnyError&) {
    return {};  // damaged EXIF
  }
}

}  // namespace

Image ReadImageHeader(const std::filesystem::path& folder, const std::string& name) {
  const std::filesystem::path path = folder / name;
  const FormatHeader header = ReadFormatHeader(path);
  Image image;
  image.name = name;
  image.width_px = static_cast<int>(header.width_px);
  image.height_px = static_cast<int>(header.height_px);
  image.channels = header.channels;
  image.bits_per_sample = header.bits_per_sample;
  image.decode_scratch_bytes = header.decode_scratch_bytes;
  image.exif = ReadExif(path, header);
  image.content = HashFile(path);
  return image;
}

}  // namespace rilievo::io
