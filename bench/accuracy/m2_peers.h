// Two nearest neighbours of descriptors by the libraries that people use, called here and nowhere else. One thread.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "block/features.h"

namespace rilievo::bench {

/// Nearest neighbours of a query: index and squared distance of the two nearest found; index -1 = none.
struct PeerNeighbors {
  std::int32_t index[2] = {-1, -1};
  float distance_sq[2] = {0, 0};
};

/// A search structure over one image's descriptors. Building is not part of a search's time.
class PeerIndex {
 public:
  virtual ~PeerIndex() = default;
  virtual std::vector<PeerNeighbors> Search(std::span<const Descriptor> queries) const = 0;
};

/// Names of the peers this build has: "opencv" (cv::BFMatcher on floats), "opencv-bytes" (on bytes), "faiss"
/// (IndexFlatL2), "flann" (four randomised kd-trees, 64 checks).
std::vector<std::string> PeerNames();
std::unique_ptr<PeerIndex> MakePeerIndex(const std::string& name, std::span<const Descriptor> descriptors);

}  // namespace rilievo::bench
