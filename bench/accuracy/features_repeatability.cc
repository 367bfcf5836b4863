// Repeatability and matching score of the stage's SIFT and OpenCV's on images of a plane with known homographies.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <optional>
#include <set>
#include <tuple>

#include "base/error.h"
#include "bench/accuracy/features_detectors.h"
#include "bench/accuracy/features_eval.h"
#include "bench/accuracy/features_overlap.h"
#include "stages/matching/matching.h"

namespace rilievo::bench {
namespace {

/// The published protocol; the same without its leniency on positions (12 px of offset pass there): regions as they
/// are, radius 3 sigma; and that with positions and scales compared only, which steep views need.
constexpr OverlapRule kProtocol{}, kStrict{.normal_radius_px = 0}, kCircles{.normal_radius_px = 0, .is_similar = true};

/// Both descriptors of one detector's features.
struct Detected {
  std::vector<Keypoint> keypoints;
  std::vector<Descriptor> plain, root;
};

Eigen::Matrix3d ReadHomography(const std::filesystem::path& path) {
  std::ifstream in(path);
  Eigen::Matrix3d h;
  for (int i = 0; i < 9; ++i) {
    if (!(in >> h(i / 3, i % 3))) throw Error(ErrorCode::kInvalidInput, path.string(), "is not a 3 x 3 matrix");
  }
  return h;
}

std::string ImagePath(const std::filesystem::path& folder, int number) {
  for (const char* ending : {".pgm", ".ppm", ".png", ".jpg"}) {
    const auto path = folder / ("img" + std::to_string(number) + ending);
    if (std::filesystem::exists(path)) return path.string();
  }
  throw Error(ErrorCode::kNotFound, folder.string(), "has no image img" + std::to_string(number));
}

/// A region a position and scale: further orientations of a keypoint are the same region.
std::vector<Keypoint> Regions(const std::vector<Keypoint>& keypoints) {
  std::set<std::tuple<float, float, float>> seen;
  std::vector<Keypoint> result;
  for (const Keypoint& k : keypoints) {
    if (seen.emplace(k.x_px, k.y_px, k.scale_px).second) result.push_back(k);
  }
  return result;
}

std::vector<Keypoint> StrongestKeypoints(std::vector<Keypoint> keypoints, std::size_t count) {
  std::stable_sort(keypoints.begin(), keypoints.end(),
                   [](const Keypoint& a, const Keypoint& b) { return a.response > b.response; });
  keypoints.resize(std::min(count, keypoints.size()));
  return keypoints;
}

/// Everything both detectors found in an image, and the same cut to equal numbers.
struct BothDetectors {
  ImageSize size;
  Detected ours, peer;
  std::vector<Keypoint> our_regions, peer_regions;
};

Detected Cut(const ImageFeatures& plain, const std::vector<Descriptor>& root, std::size_t count) {
  ImageFeatures with_root{.keypoints = plain.keypoints, .descriptors = root, .colors = {}};
  ImageFeatures a = Strongest(plain, count), b = Strongest(with_root, count);
  return {.keypoints = std::move(a.keypoints), .plain = std::move(a.descriptors), .root = std::move(b.descriptors)};
}

BothDetectors DetectBoth(const GreyImage& image) {
  SerialRunContext context;
  features::Options options = AllFeatures();
  const ImageFeatures our_root = DetectOurs(image, options, context);
  options.root_sift = false;
  const ImageFeatures our_plain = DetectOurs(image, options, context);
  if (our_root.keypoints.size() != our_plain.keypoints.size())
    throw Error(ErrorCode::kInternal, "", "RootSIFT changes the number of features");
  const ImageFeatures peer =
      DetectPeer(image, {.contrast_threshold = options.contrast_threshold, .edge_threshold = options.edge_threshold});
  const std::size_t features = std::min(our_plain.keypoints.size(), peer.keypoints.size());
  std::vector<Keypoint> our_regions = Regions(our_plain.keypoints), peer_regions = Regions(peer.keypoints);
  const std::size_t regions = std::min(our_regions.size(), peer_regions.size());
  return {.size = {image.width_px, image.height_px},
          .ours = Cut(our_plain, our_root.descriptors, features),
          .peer = Cut(peer, RootSift(peer.descriptors), features),
          .our_regions = StrongestKeypoints(std::move(our_regions), regions),
          .peer_regions = StrongestKeypoints(std::move(peer_regions), regions)};
}

Json Repeatability(const PlanarPair& pair, const OverlapRule& rule) {
  const CommonPart common = FindCommonPart(pair);
  const auto found = OneToOne(OverlappingRegions(pair, common, rule), pair.first.size(), pair.second.size());
  const double share =
      common.Smaller() == 0 ? 0 : static_cast<double>(found.size()) / static_cast<double>(common.Smaller());
  return {{"share", share}, {"count", found.size()}, {"in_common", common.Smaller()}};
}

/// Nearest neighbours of all features, ratio 0.8, mutual; correct where the regions overlap enough; as a share of the
/// smaller number of features in the common part.
Json MatchingScore(const PlanarPair& pair, const std::vector<Descriptor>& first, const std::vector<Descriptor>& second,
                   const OverlapRule& rule) {
  SerialRunContext context;
  const CommonPart common = FindCommonPart(pair);
  std::set<std::pair<std::uint32_t, std::uint32_t>> true_pairs;
  for (const RegionPair& p : OverlappingRegions(pair, common, rule)) true_pairs.emplace(p.first, p.second);
  const auto matches = matching::Run(first, second, {.ratio = 0.8, .mutual = true}, context);
  const auto correct = static_cast<std::size_t>(std::count_if(matches.begin(), matches.end(), [&](const Match& m) {
    return true_pairs.count({m.first, m.second}) > 0;
  }));
  const double share = common.Smaller() == 0 ? 0 : static_cast<double>(correct) / static_cast<double>(common.Smaller());
  return {{"share", share}, {"count", correct}, {"matches", matches.size()}, {"in_common", common.Smaller()}};
}

Json PairFigures(const Detected& first, const Detected& second, const std::vector<Keypoint>& first_regions,
                 const std::vector<Keypoint>& second_regions, const ImageSize& first_size, const ImageSize& second_size,
                 const Eigen::Matrix3d& h) {
  const auto planar = [&](const std::vector<Keypoint>& a, const std::vector<Keypoint>& b) {
    return PlanarPair{
        .first = a, .second = b, .first_size = first_size, .second_size = second_size, .second_from_first = h};
  };
  const PlanarPair regions = planar(first_regions, second_regions), all = planar(first.keypoints, second.keypoints);
  Json repeatability, matching;
  for (const auto& [name, rule] : {std::pair{"protocol", kProtocol}, {"strict", kStrict}, {"circles", kCircles}}) {
    repeatability[name] = Repeatability(regions, rule);
    matching[std::string("SIFT, ") + name] = MatchingScore(all, first.plain, second.plain, rule);
    matching[std::string("RootSIFT, ") + name] = MatchingScore(all, first.root, second.root, rule);
  }
  return {{"features", {first.keypoints.size(), second.keypoints.size()}},
          {"regions", {first_regions.size(), second_regions.size()}},
          {"repeatability", repeatability},
          {"matching", matching}};
}

}  // namespace

Json MeasureRepeatability(const std::string& folder) {
  std::vector<BothDetectors> images;
  for (int i = 1; i <= 6; ++i) images.push_back(DetectBoth(LoadGrey(ImagePath(folder, i))));
  Json pairs = Json::array();
  const BothDetectors& a = images[0];
  for (int i = 2; i <= 6; ++i) {
    const Eigen::Matrix3d h = ReadHomography(std::filesystem::path(folder) / ("H1to" + std::to_string(i) + "p"));
    const BothDetectors& b = images[static_cast<std::size_t>(i - 1)];
    pairs.push_back({{"pair", "1-" + std::to_string(i)},
                     {"ours", PairFigures(a.ours, b.ours, a.our_regions, b.our_regions, a.size, b.size, h)},
                     {"opencv", PairFigures(a.peer, b.peer, a.peer_regions, b.peer_regions, a.size, b.size, h)}});
  }
  return {{"folder", folder}, {"pairs", pairs}};
}

}  // namespace rilievo::bench
