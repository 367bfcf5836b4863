// The block: cameras and images, in a fixed order.
#pragma once

#include <vector>

#include "block/camera.h"
#include "block/image.h"

namespace rilievo {

/// images[i].id == ImageId(i), cameras[c].id == CameraId(c). Images are in sequence order (natural order of names or a
/// given order).
struct Block {
  std::vector<Camera> cameras;
  std::vector<Image> images;
  std::vector<QuarantinedImage> quarantined;

  const Image& image(ImageId id) const { return images.at(id.value); }
  const Camera& camera(CameraId id) const { return cameras.at(id.value); }
  const Camera& camera_of(ImageId id) const { return camera(image(id).camera_id); }
};

}  // namespace rilievo
