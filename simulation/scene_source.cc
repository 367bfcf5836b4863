// Images of a scene by name.
#include "simulation/scene_source.h"

#include <cmath>
#include <cstdio>
#include <string>
#include <utility>

namespace rilievo::simulation {

ScenePixelSource::ScenePixelSource(std::shared_ptr<const Renderer> renderer) : renderer_(std::move(renderer)) {
  const auto& names = renderer_->scene().names;
  for (std::size_t i = 0; i < names.size(); ++i) index_[names[i]] = i;
}

GreyImage ScenePixelSource::Load(const std::string& image_name, bool with_color) const {
  const auto found = index_.find(image_name);
  if (found == index_.end()) throw Error(ErrorCode::kNotFound, image_name, "is not an image of the scene");
  GreyImage image = renderer_->RenderGrey(found->second);
  if (!with_color) return image;
  const std::size_t pixels = static_cast<std::size_t>(image.width_px) * image.height_px;
  image.rgb.resize(3 * pixels);
  for (std::size_t i = 0; i < pixels; ++i) {
    const auto grey = image.Is16Bit() ? static_cast<std::uint8_t>(image.u16[i] >> 8) : image.u8[i];
    image.rgb[3 * i] = image.rgb[3 * i + 1] = image.rgb[3 * i + 2] = grey;
  }
  return image;
}

std::uint64_t ScenePixelSource::LoadPeakBytes(const Image& image, bool with_color) const {
  const auto pixels = static_cast<std::uint64_t>(image.width_px) * static_cast<std::uint64_t>(image.height_px);
  return EstimateRenderBytes(renderer_->scene()).per_image + (with_color ? 3 * pixels : 0);
}

ExifData SceneExif(const Scene& scene, std::size_t image) {
  constexpr double kSensor_mm = 36;
  ExifData exif;
  exif.focal_mm = std::round(1000 * kSensor_mm * scene.camera.model.fx / scene.camera.width_px) / 1000;
  exif.focal_35mm_mm = std::round(exif.focal_mm);
  exif.make = "Rilievo";
  exif.model = "Simulated camera";
  exif.serial = "SIM" + std::to_string(scene.options.seed);
  exif.lens = "Simulated lens";
  char text[32];
  const std::size_t minutes = image % 1440;  // one exposure a minute
  std::snprintf(text, sizeof text, "2025:01:%02d %02d:%02d:00", static_cast<int>(1 + image / 1440 % 28),
                static_cast<int>(minutes / 60), static_cast<int>(minutes % 60));
  exif.date_time = text;
  exif.focal_plane_x_res_per_mm = scene.camera.width_px / kSensor_mm;
  return exif;
}

Block SceneBlock(const Scene& scene) {
  Block block;
  block.cameras.push_back(scene.camera);
  const std::string text = SceneText(scene);
  for (std::size_t i = 0; i < scene.names.size(); ++i) {
    Image image;
    image.id = ImageId(static_cast<std::uint32_t>(i));
    image.camera_id = scene.camera.id;
    image.name = scene.names[i];
    image.width_px = scene.camera.width_px;
    image.height_px = scene.camera.height_px;
    image.channels = 1;
    image.bits_per_sample = std::stoi(scene.options.bits);
    image.exif = SceneExif(scene, i);
    image.content = KeyHasher().Add(text).Add(static_cast<std::uint64_t>(i)).Finish();
    block.images.push_back(std::move(image));
  }
  return block;
}

}  // namespace rilievo::simulation
