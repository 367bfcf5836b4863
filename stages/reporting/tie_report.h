// The part of the orientation report that says how matches became tie points.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "block/tie_summary.h"

namespace rilievo::reporting {

/// A few lines; one about triplets for a sequence only, one about the reduction where there was one.
std::string TieText(const TieSummary& ties);
nlohmann::json TieJson(const TieSummary& ties);

}  // namespace rilievo::reporting
