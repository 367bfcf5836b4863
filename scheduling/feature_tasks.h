// The tasks that detect the features of images.
#pragma once

#include <memory>

#include "block/features.h"
#include "engine/plan.h"
#include "scheduling/orient_run.h"

namespace rilievo::scheduling {

/// Detects and publishes the features of one image, or finds them; fills run->images. An image that turns out broken
/// gets an artifact that says so.
TaskId AddFeatureTask(const std::shared_ptr<OrientRun>& run, const Image& image, engine::Plan& plan);

/// The features of one image, which its feature task has published. Throws Error(kUnreadable) when they are gone.
ImageFeatures LoadFeatures(const OrientRun& run, ImageId id, engine::TaskContext& context);

}  // namespace rilievo::scheduling
