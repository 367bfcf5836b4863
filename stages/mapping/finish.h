// The last adjustment of a grown model, its datum and its colours.
#pragma once

#include <functional>
#include <optional>

#include "base/run_context.h"
#include "block/model.h"
#include "stages/mapping/growth.h"

namespace rilievo::mapping {

/// Adjusts everything: robustly until the rejections at three sigma settle, then by least squares to convergence. Sets
/// the datum (see NormalizeDatum) and the points' colours. None when fewer than two images keep their rays. Steps: 0
/// settles, 1 adjusts robustly, 2 to 5 reject. Goes on from where `state` stands; calls `keep` after each step.
std::optional<Model> Finish(const GrowthInput& input, const Input& data, FinishState& state,
                            const std::function<void()>& keep, RunContext& context);

/// Datum of a free model: origin at the centre of gravity of the projection centres, their mean distance from it 1,
/// axes parallel to those of the image of lowest id (x right, y down, z forward).
void NormalizeDatum(Model& model);

}  // namespace rilievo::mapping
