// The measured peak of this machine: what a core does at most of the instructions that kernels are made of.
#pragma once

#include "base/run_context.h"

namespace rilievo::engine {

/// Multiply-adds a second on one core, of its widest instruction for that arithmetic; 0 where no loop is known for the
/// processor. Takes about 50 ms; the best of several short runs, for another program may take the core.
double MeasurePeak_per_s(KernelName::Arithmetic arithmetic);

}  // namespace rilievo::engine
