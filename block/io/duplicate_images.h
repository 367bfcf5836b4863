// Finds photographs that are in the folder twice.
#pragma once

#include <vector>

#include "block/image.h"

namespace rilievo::io {

/// Moves every image whose file has the bytes (`content`) of an earlier one to the end of `quarantined`: a copy, say in
/// a backup folder, would count as independent measurements from the same place. The others keep order and ids.
void QuarantineDuplicates(std::vector<Image>& images, std::vector<QuarantinedImage>& quarantined);

}  // namespace rilievo::io
