// Matching of the descriptors of two images: two nearest neighbours, ratio test, mutual check.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/option.h"
#include "base/run_context.h"
#include "base/task_cost.h"
#include "block/features.h"
#include "block/pair.h"
#include "stages/matching/two_nearest.h"

namespace rilievo::matching {

struct Options {
  double ratio = 0.8;
  bool mutual = true;
  std::string matcher = "auto";
  int kd_checks = 256;
  int visited_cells = 12;
};

std::span<const OptionDeclaration<Options>> OptionDeclarations();
inline constexpr int kVersion = 1;

/// How the two nearest neighbours are found: m2 compares all with all, the others are docs/decisions/0011.
enum class Matcher : std::uint8_t { kM2, kKdTree, kCells };

/// Comparisons of one pair above which `auto` takes cells instead of m2: two images of 65,536 features.
inline constexpr std::uint64_t kMostM2Comparisons = std::uint64_t{1} << 32;

/// The matcher of two images by the option or, for `auto`, by the numbers of their features alone.
Matcher MatcherFor(std::size_t features_a, std::size_t features_b, const Options& options);

TaskCost Estimate(std::size_t features_a, std::size_t features_b, const Options& options);

/// Matches a[i] ~ b[j] with d1 < ratio * d2 (Euclidean, exact integer arithmetic: d1^2 * 10^8 < round(ratio * 10^4)^2 *
/// d2^2 or an equivalent exact comparison), both ways when `mutual`; one-to-one, sorted by first. Ties go to the lower
/// index. All kernels (scalar, AVX2, AVX-512 VNNI; RILIEVO_KERNELS forces one) give the same matches.
std::vector<Match> Run(std::span<const Descriptor> a, std::span<const Descriptor> b, const Options& options,
                       RunContext& context);

/// The same of images prepared for the same options: an image takes part in many pairs and is packed once.
std::vector<Match> Run(const Prepared& a, const Prepared& b, const Options& options, RunContext& context);

/// Upper bound of the bytes of prepared descriptors, on this processor, and of preparing them.
std::size_t PreparedBytes(std::size_t features, const Options& options);

/// The descriptors, which must outlive the result, as the sweeps of m2 read them: PreparedBytes more.
Prepared Prepare(std::span<const Descriptor> descriptors, const Options& options);

/// The same where features of another sign do not exist: bright blobs are compared with bright ones only (SURF; SPEC
/// 1.2). Holds a copy of the descriptors beside what Run needs, 132 bytes each.
std::vector<Match> RunBySign(const ImageFeatures& a, const ImageFeatures& b, const Options& options,
                             RunContext& context);

}  // namespace rilievo::matching
