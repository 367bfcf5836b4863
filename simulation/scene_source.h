// A scene as a block of photographs, without going through disk.
#pragma once

#include <map>
#include <memory>
#include <string>

#include "block/block.h"
#include "block/pixels.h"
#include "simulation/renderer.h"

namespace rilievo::simulation {

/// Renders images on demand; equal to what the image files hold except for the losses of JPEG. Thread safe.
class ScenePixelSource : public PixelSource {
 public:
  explicit ScenePixelSource(std::shared_ptr<const Renderer> renderer);
  /// Throws Error(kNotFound) for a name the scene does not have. With colour the grey value is repeated.
  GreyImage Load(const std::string& image_name, bool with_color) const override;
  /// What one call holds; the renderer itself is not counted (EstimateRenderBytes().shared).
  std::uint64_t LoadPeakBytes(const Image& image, bool with_color) const override;

 private:
  std::shared_ptr<const Renderer> renderer_;
  std::map<std::string, std::size_t> index_;
};

/// EXIF data of image `image`, as written into the files: a full-frame camera ("Rilievo", 36 mm wide).
ExifData SceneExif(const Scene& scene, std::size_t image);

/// The block of the scene: its camera (given calibration) and images. An image's content digest is the hash of the
/// scene file's text and the image's index: it changes whenever a pixel may.
Block SceneBlock(const Scene& scene);

}  // namespace rilievo::simulation
