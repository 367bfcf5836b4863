// The same least squares by Ceres: the oracle of the reduced system's solver, and what large blocks use.
#pragma once

#include "stages/adjustment/schur_solver.h"

namespace rilievo::adjustment {

/// As SolveBundle. One thread; dense up to `most_images_dense` images, else sparse. Throws Cancelled on a stop request.
BundleSummary SolveWithCeres(BundleProblem& problem, const BundleOptions& options, std::size_t most_images_dense,
                             RunContext& context);

}  // namespace rilievo::adjustment
