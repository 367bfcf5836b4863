// The choice of kernels (base/kernel_choice.h) under the names that this stage knows it by.
#pragma once

#include "base/kernel_choice.h"

namespace rilievo::features {

using rilievo::ChooseKernels;
using rilievo::ForcedKernels;
using rilievo::SupportedLevels;

}  // namespace rilievo::features
