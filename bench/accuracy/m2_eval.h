// The sub-commands of m2_eval; each gives the JSON that it prints. All throw Error.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace rilievo::bench {

using Json = nlohmann::ordered_json;

/// CPU seconds of both directions of exact matching, COUNT descriptors of the first half of the images against as many
/// of the second half, by every kernel of this processor, beside the peak of its multiply-add.
Json MeasureM2(std::size_t count, int repeats, const std::vector<std::string>& images);
/// The same by a library, search in both directions without building: CPU seconds, and the share of our mutual
/// ratio-passing matches that it finds.
Json MeasurePeer(const std::string& name, std::size_t count, int repeats, const std::vector<std::string>& images);
/// Throughput of two threads over one's for all pairs of the images, matched and verified, beside a pure FMA loop's.
Json MeasurePairScaling(const std::vector<std::string>& images);

}  // namespace rilievo::bench
