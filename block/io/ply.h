// Object points and projection centres as PLY (docs/formats/exports.md).
#pragma once

#include "block/block.h"
#include "block/io/file_set.h"
#include "block/model.h"

namespace rilievo::io {

enum class PlyForm { kText, kBinary };

/// points.ply: x y z (double), red green blue, rays, rms_px (RMS of the reprojection errors). cameras.ply: projection
/// centres of the oriented images in block order with nx ny nz = viewing direction and image = number in the block,
/// red.
FileSet Ply(const Block& block, const Model& model, PlyForm form);

}  // namespace rilievo::io
