// COLMAP's sparse model: cameras, images, points3D, as text or binary (docs/formats/exports.md).
#pragma once

#include "block/block.h"
#include "block/io/file_set.h"
#include "block/model.h"

namespace rilievo::io {

/// cameras.txt, images.txt, points3D.txt. Ids are index + 1; all cameras, the oriented images only; an image's 2D
/// points are its observations in the order of the model's points; a point's error is the RMS of its reprojection
/// errors in px. Numbers are exact (shortest text that reads back the same).
FileSet ColmapText(const Block& block, const Model& model);
/// cameras.bin, images.bin, points3D.bin: the same content, little endian.
FileSet ColmapBinary(const Block& block, const Model& model);

struct ColmapModel {
  Block block;  ///< cameras and images in the order of their ids; images have name, camera and the camera's size
  Model model;
};

/// Reads either form (told by the names). Feature numbers are indices into the image's 2D points; residuals are
/// recomputed. 2D points without 3D point are dropped. Throws Error with file and line for damaged content.
ColmapModel ReadColmap(const FileSet& files);

}  // namespace rilievo::io
