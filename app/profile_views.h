// The profile of a run for people, for programs and as a page.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "engine/run_profile.h"

namespace rilievo::app {

/// A table a stage, then kernels, critical path and idle gaps.
std::string ProfileText(const engine::RecordedRun& run, const engine::RunProfile& profile);

/// docs/formats/profile.md.
nlohmann::json ProfileJson(const engine::RecordedRun& run, const engine::RunProfile& profile);

/// A page that needs nothing else: the tables, and a timeline to zoom and pan. `title` is shown at the top.
std::string ProfilePage(const engine::RecordedRun& run, const engine::RunProfile& profile, const std::string& title);

/// The page around its data: "@TITLE@" and "@DATA@" stand for what ProfilePage puts in.
extern const char* const kProfilePage;

}  // namespace rilievo::app
