// Correct matches by descriptor: on photographs of a plane with known homographies, and in rendered blocks.
#include <Eigen/Eigenvalues>
#include <cmath>
#include <filesystem>
#include <fstream>

#include "base/error.h"
#include "bench/accuracy/features_clock.h"
#include "bench/accuracy/features_detectors.h"
#include "bench/accuracy/features_eval.h"
#include "bench/accuracy/features_moments.h"
#include "simulation/renderer.h"
#include "stages/matching/matching.h"

namespace rilievo::bench {
namespace {

/// A match is correct when the second feature lies this near to where the first one's point is.
constexpr double kGate_px = 3;
constexpr const char* kDescriptors[] = {"sift", "rootsift", "gloh", "pca-sift", "surf-128"};

features::Options OptionsOf(const std::string& descriptor) {
  features::Options options = AllFeatures();
  options.detector = descriptor == "rootsift" ? "sift" : descriptor;
  options.root_sift = descriptor != "sift";
  return options;
}

/// Matches of two images, and those whose point `there` agrees with.
template <class F>
Json Count(const ImageFeatures& a, const ImageFeatures& b, const std::string& descriptor, F&& there) {
  SerialRunContext context;
  const matching::Options options{.ratio = 0.8, .mutual = true};
  const auto matches = features::ComparesEqualSignsOnly(OptionsOf(descriptor))
                           ? matching::RunBySign(a, b, options, context)
                           : matching::Run(a.descriptors, b.descriptors, options, context);
  std::size_t correct = 0;
  for (const Match& m : matches) {
    const std::optional<Eigen::Vector2d> expected = there(a.keypoints[m.first].Position());
    if (expected && (*expected - b.keypoints[m.second].Position()).norm() <= kGate_px) ++correct;
  }
  return {{"features", {a.keypoints.size(), b.keypoints.size()}}, {"matches", matches.size()}, {"correct", correct}};
}

std::vector<ImageFeatures> DetectAll(const std::vector<GreyImage>& images, const std::string& descriptor) {
  SerialRunContext context;
  std::vector<ImageFeatures> features;
  for (const GreyImage& image : images) features.push_back(DetectOurs(image, OptionsOf(descriptor), context));
  return features;
}

Eigen::Matrix3d ReadHomography(const std::filesystem::path& path) {
  std::ifstream in(path);
  Eigen::Matrix3d h;
  for (int i = 0; i < 9; ++i)
    if (!(in >> h(i / 3, i % 3))) throw Error(ErrorCode::kInvalidInput, path.string(), "is not a 3 x 3 matrix");
  return h;
}

/// Share of the variance that a projection keeps, and the most that one of its size learnt here would.
Json Kept(const Moments& moments, const features::StoredProjection& stored) {
  const Eigen::MatrixXd covariance = moments.Covariance(), rows = Rows(stored);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(covariance, Eigen::EigenvaluesOnly);
  return {{"features", moments.count()},
          {"kept", (rows * covariance * rows.transpose()).trace() / covariance.trace()},
          {"at_most", solver.eigenvalues().tail(stored.outputs).sum() / covariance.trace()}};
}

std::vector<GreyImage> LoadFolder(const std::filesystem::path& folder) {
  std::vector<GreyImage> images;
  for (int i = 1; i <= 6; ++i) {
    for (const char* ending : {".pgm", ".ppm", ".png", ".jpg"}) {
      const auto path = folder / ("img" + std::to_string(i) + ending);
      if (std::filesystem::exists(path)) images.push_back(LoadGrey(path.string()));
    }
  }
  return images;
}

Json OnPhotographs(const std::filesystem::path& folder) {
  const std::vector<GreyImage> images = LoadFolder(folder);
  if (images.size() != 6) throw Error(ErrorCode::kNotFound, folder.string(), "has no images img1 to img6");
  Json result;
  for (const char* descriptor : kDescriptors) {
    const std::vector<ImageFeatures> features = DetectAll(images, descriptor);
    for (std::size_t i = 1; i < images.size(); ++i) {
      const Eigen::Matrix3d h = ReadHomography(folder / ("H1to" + std::to_string(i + 1) + "p"));
      // The homographies count from the first pixel's centre.
      const Eigen::Vector2d half(0.5, 0.5);
      result["1-" + std::to_string(i + 1)][descriptor] =
          Count(features[0], features[i], descriptor, [&](const Eigen::Vector2d& p) -> std::optional<Eigen::Vector2d> {
            return (h * (p - half).homogeneous()).hnormalized() + half;
          });
    }
  }
  DescriptorMoments moments;
  for (const GreyImage& image : images) moments.Add(image);
  result["variance"] = {{"gloh", Kept(moments.gloh, features::kGlohProjection)},
                        {"pca-sift", Kept(moments.pca_sift, features::kPcaSiftProjection)}};
  return result;
}

Json OnScene(const simulation::SceneOptions& options) {
  const simulation::Renderer renderer(simulation::MakeScene(options));
  std::vector<GreyImage> images;
  for (std::size_t i = 0; i < static_cast<std::size_t>(options.images); ++i) images.push_back(renderer.RenderGrey(i));
  Json result;
  for (const char* descriptor : kDescriptors) {
    const std::vector<ImageFeatures> features = DetectAll(images, descriptor);
    for (std::size_t i = 1; i < images.size(); ++i) {
      result["1-" + std::to_string(i + 1)][descriptor] =
          Count(features[0], features[i], descriptor, [&](const Eigen::Vector2d& p) -> std::optional<Eigen::Vector2d> {
            const auto point = renderer.SurfacePoint(0, p);
            return point ? renderer.Project(i, *point) : std::nullopt;
          });
    }
  }
  return result;
}

}  // namespace

Json MeasureDescriptors(const std::vector<std::string>& folders) {
  Json result;
  for (const std::string& folder : folders) result[folder] = OnPhotographs(folder);
  for (const char* surface : {"relief", "statue"}) {
    simulation::SceneOptions options;
    options.surface = surface;
    options.images = 4;
    options.width_px = 1600;
    options.height_px = 1200;
    options.angle_step_deg = 10;
    options.seed = 7;
    result[surface] = OnScene(options);
  }
  return result;
}

}  // namespace rilievo::bench
