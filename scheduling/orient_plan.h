// Expands a block and options into an engine plan: features -> pairs (matching, verification) -> orientation.
#pragma once

#include <memory>

#include "engine/plan.h"
#include "scheduling/orient_run.h"
#include "scheduling/orientation_task.h"

namespace rilievo::scheduling {

/// The plan: one task an image, one a tile of the pair matrix, column by column, each right after its last image; the
/// orientation task, if the run goes so far, is added when all counts are known, with a cost from those counts. The
/// pairs of a guided block are added as they become known (scheduling/guided_plan.h).
engine::Plan MakeOrientPlan(std::shared_ptr<OrientRun> run);

}  // namespace rilievo::scheduling
