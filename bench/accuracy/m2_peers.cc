// Two nearest neighbours of descriptors by OpenCV, and by Faiss and FLANN where they are installed.
#include "bench/accuracy/m2_peers.h"

#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>

#include "base/error.h"

#ifdef RILIEVO_HAS_FAISS
#include <faiss/IndexFlat.h>
#endif
#ifdef RILIEVO_HAS_FLANN
#include <flann/flann.hpp>
#endif

namespace rilievo::bench {
namespace {

[[maybe_unused]] std::vector<float> Floats(std::span<const Descriptor> descriptors) {
  std::vector<float> floats;
  floats.reserve(128 * descriptors.size());
  for (const Descriptor& d : descriptors) floats.insert(floats.end(), d.begin(), d.end());
  return floats;
}

class OpenCvIndex : public PeerIndex {
 public:
  OpenCvIndex(std::span<const Descriptor> descriptors, int type) : type_(type), train_(Mat(descriptors)) {
    cv::setNumThreads(1);
  }
  std::vector<PeerNeighbors> Search(std::span<const Descriptor> queries) const override {
    std::vector<std::vector<cv::DMatch>> found;
    cv::BFMatcher(cv::NORM_L2).knnMatch(Mat(queries), train_, found, 2);
    std::vector<PeerNeighbors> result(queries.size());
    for (std::size_t i = 0; i < found.size(); ++i) {
      for (std::size_t k = 0; k < found[i].size(); ++k) {
        result[i].index[k] = found[i][k].trainIdx;
        result[i].distance_sq[k] = found[i][k].distance * found[i][k].distance;
      }
    }
    return result;
  }

 private:
  cv::Mat Mat(std::span<const Descriptor> descriptors) const {
    cv::Mat bytes(static_cast<int>(descriptors.size()), 128, CV_8U), result;
    std::copy_n(descriptors.data()->data(), 128 * descriptors.size(), bytes.data);
    bytes.convertTo(result, type_);
    return result;
  }
  int type_;
  cv::Mat train_;
};

#ifdef RILIEVO_HAS_FAISS
class FaissIndex : public PeerIndex {
 public:
  explicit FaissIndex(std::span<const Descriptor> descriptors) : index_(128) {
    index_.add(static_cast<faiss::Index::idx_t>(descriptors.size()), Floats(descriptors).data());
  }
  std::vector<PeerNeighbors> Search(std::span<const Descriptor> queries) const override {
    std::vector<float> distances(2 * queries.size());
    std::vector<faiss::Index::idx_t> labels(2 * queries.size());
    index_.search(static_cast<faiss::Index::idx_t>(queries.size()), Floats(queries).data(), 2, distances.data(),
                  labels.data());
    std::vector<PeerNeighbors> result(queries.size());
    for (std::size_t i = 0; i < labels.size(); ++i) {
      result[i / 2].index[i % 2] = static_cast<std::int32_t>(labels[i]);
      result[i / 2].distance_sq[i % 2] = distances[i];
    }
    return result;
  }

 private:
  faiss::IndexFlatL2 index_;
};
#endif

#ifdef RILIEVO_HAS_FLANN
class FlannIndex : public PeerIndex {
 public:
  explicit FlannIndex(std::span<const Descriptor> descriptors)
      : floats_(Floats(descriptors)),
        index_(flann::Matrix<float>(floats_.data(), descriptors.size(), 128), flann::KDTreeIndexParams(4)) {
    index_.buildIndex();
  }
  std::vector<PeerNeighbors> Search(std::span<const Descriptor> queries) const override {
    std::vector<float> floats = Floats(queries), distances(2 * queries.size());
    std::vector<int> indices(2 * queries.size(), -1);
    flann::SearchParams parameters(64);
    parameters.cores = 1;
    flann::Matrix<int> found(indices.data(), queries.size(), 2);
    flann::Matrix<float> squared(distances.data(), queries.size(), 2);
    index_.knnSearch(flann::Matrix<float>(floats.data(), queries.size(), 128), found, squared, 2, parameters);
    std::vector<PeerNeighbors> result(queries.size());
    for (std::size_t i = 0; i < indices.size(); ++i) {
      result[i / 2].index[i % 2] = indices[i];
      result[i / 2].distance_sq[i % 2] = distances[i];
    }
    return result;
  }

 private:
  std::vector<float> floats_;
  flann::Index<flann::L2<float>> index_;
};
#endif

}  // namespace

std::vector<std::string> PeerNames() {
  std::vector<std::string> names{"opencv", "opencv-bytes"};
#ifdef RILIEVO_HAS_FAISS
  names.emplace_back("faiss");
#endif
#ifdef RILIEVO_HAS_FLANN
  names.emplace_back("flann");
#endif
  return names;
}

std::unique_ptr<PeerIndex> MakePeerIndex(const std::string& name, std::span<const Descriptor> descriptors) {
  if (name == "opencv") return std::make_unique<OpenCvIndex>(descriptors, CV_32F);
  if (name == "opencv-bytes") return std::make_unique<OpenCvIndex>(descriptors, CV_8U);
#ifdef RILIEVO_HAS_FAISS
  if (name == "faiss") return std::make_unique<FaissIndex>(descriptors);
#endif
#ifdef RILIEVO_HAS_FLANN
  if (name == "flann") return std::make_unique<FlannIndex>(descriptors);
#endif
  throw Error(ErrorCode::kUsage, name, "this build has no such peer", "install it with scripts/setup --peers");
}

}  // namespace rilievo::bench
