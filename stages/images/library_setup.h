// Process-wide settings of the image library, made once at the start of a program.
#pragma once

namespace rilievo::images {

/// One thread per call (parallelism is the engine's) and no messages of its own. Call before any image is read.
void PrepareImageLibrary();

}  // namespace rilievo::images
