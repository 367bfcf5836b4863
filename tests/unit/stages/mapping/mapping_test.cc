// The mapper against exact synthetic blocks: recovery, noise, wrong matches, components, degenerate input.
#include "stages/mapping/mapping.h"

#include <gtest/gtest.h>
#include <malloc.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "geometry/similarity3.h"
#include "tests/support/synthetic_block.h"

namespace rilievo {
namespace {

using mapping::Input;
using mapping::Options;
using mapping::Output;
using test::Layout;
using test::MakeSyntheticBlock;
using test::Object;
using test::SyntheticBlock;
using test::SyntheticOptions;

Output Map(const SyntheticBlock& b, const Options& options = {}) {
  SerialRunContext context(5);
  return mapping::Run({b.block, b.keypoints, b.colors, b.pairs, b.tracks}, options, context);
}

struct Deviation {
  double center = 0;    ///< root mean square, units of the object
  double rotation = 0;  ///< largest, rad
};

/// After the similarity that fits the projection centres best.
Deviation DeviationFromTruth(const SyntheticBlock& b, const Model& model) {
  std::vector<Eigen::Vector3d> estimated, truth;
  for (const auto& [image, pose] : model.cam_from_world) {
    estimated.push_back(pose.Center());
    truth.push_back(b.cam_from_world[image.value].Center());
  }
  const auto truth_from_model = FitSimilarity(estimated, truth);
  Deviation deviation{1e9, 1e9};
  if (!truth_from_model) return deviation;
  double sum = 0;
  deviation.rotation = 0;
  for (const auto& [image, pose] : model.cam_from_world) {
    const Rigid3 aligned = TransformPose(*truth_from_model, pose);
    sum += (aligned.Center() - b.cam_from_world[image.value].Center()).squaredNorm();
    deviation.rotation =
        std::max(deviation.rotation, aligned.rotation.angularDistance(b.cam_from_world[image.value].rotation));
  }
  deviation.center = std::sqrt(sum / static_cast<double>(estimated.size()));
  return deviation;
}

TEST(Mapping, NoiseFreeBlockIsRecoveredExactly) {
  const SyntheticBlock b = MakeSyntheticBlock({});
  const Output output = Map(b);
  ASSERT_EQ(output.models.size(), 1u);
  EXPECT_TRUE(output.unoriented.empty());
  const Model& model = output.models[0];
  ASSERT_EQ(model.cam_from_world.size(), 8u);
  const Deviation d = DeviationFromTruth(b, model);
  EXPECT_LT(d.center, 1e-6);
  EXPECT_LT(d.rotation, 1e-6);
  EXPECT_GT(model.points.size(), 0.95 * static_cast<double>(b.points.size()));
  EXPECT_LT(model.sigma0_px, 1e-3);  // keypoints are floats
}

TEST(Mapping, DatumIsTheCentresOfProjection) {
  const Output output = Map(MakeSyntheticBlock({}));
  ASSERT_EQ(output.models.size(), 1u);
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  double distance = 0;
  for (const auto& [image, pose] : output.models[0].cam_from_world)
    mean += pose.Center(), distance += pose.Center().norm() / 8;
  EXPECT_LT(mean.norm(), 1e-12);
  EXPECT_NEAR(distance, 1, 1e-12);
  EXPECT_LT(output.models[0].cam_from_world.begin()->second.rotation.angularDistance(Eigen::Quaterniond::Identity()),
            1e-12);
}

TEST(Mapping, NoiseComesBackAsSigma0) {
  SyntheticOptions o;
  o.noise_px = 0.5;
  const SyntheticBlock b = MakeSyntheticBlock(o);
  const Output output = Map(b);
  ASSERT_EQ(output.models.size(), 1u);
  const Model& model = output.models[0];
  EXPECT_EQ(model.cam_from_world.size(), 8u);
  EXPECT_NEAR(model.sigma0_px, 0.5, 0.015);
  long observations = 0;
  double squares = 0;
  for (const Point& p : model.points)
    for (const Observation& obs : p.observations) observations += 2, squares += obs.residual_px.squaredNorm();
  EXPECT_EQ(model.redundancy, observations - 3 * static_cast<long>(model.points.size()) - 6 * 8 + 7);
  EXPECT_NEAR(std::sqrt(squares / static_cast<double>(model.redundancy)), model.sigma0_px, 1e-9);
  // A centre is fixed by hundreds of rays of 0.5 px at 1500 px focal length and 3.2 units: some 1e-4 of the distance.
  EXPECT_LT(DeviationFromTruth(b, model).center, 3.2 * 3e-4);
}

TEST(Mapping, WrongMatchesAreLeftOut) {
  SyntheticOptions o;
  o.noise_px = 0.5;
  o.wrong_share = 0.1;
  const SyntheticBlock b = MakeSyntheticBlock(o);
  ASSERT_GT(b.wrong.size(), 500u);
  const Output output = Map(b);
  ASSERT_EQ(output.models.size(), 1u);
  const Model& model = output.models[0];
  EXPECT_EQ(model.cam_from_world.size(), 8u);
  EXPECT_LT(DeviationFromTruth(b, model).center, 3.2 * 3e-4);
  EXPECT_NEAR(model.sigma0_px, 0.5, 0.02);
  std::size_t wrong = 0, rays = 0;
  for (const Point& p : model.points)
    for (const Observation& obs : p.observations) wrong += b.wrong.contains(obs.feature), ++rays;
  EXPECT_LT(wrong, rays / 500);
}

TEST(Mapping, DisconnectedScenesGiveSeveralModels) {
  SyntheticOptions o;
  o.images = 5;
  o.scenes = 2;
  o.points = 500;
  const SyntheticBlock b = MakeSyntheticBlock(o);
  const Output output = Map(b);
  ASSERT_EQ(output.models.size(), 2u);
  EXPECT_TRUE(output.unoriented.empty());
  for (const Model& model : output.models) {
    EXPECT_EQ(model.cam_from_world.size(), 5u);
    EXPECT_EQ(model.cam_from_world.begin()->first.value / 5, model.cam_from_world.rbegin()->first.value / 5);
    EXPECT_LT(DeviationFromTruth(b, model).center, 1e-6);
  }
}

TEST(Mapping, RingInSequencePairsCloses) {
  SyntheticOptions o;
  o.layout = Layout::kRing;
  o.object = Object::kSphere;
  o.images = 40;
  o.points = 3000;
  o.noise_px = 0.3;
  o.sequence_window = 2;
  const SyntheticBlock b = MakeSyntheticBlock(o);
  const Output output = Map(b);
  ASSERT_EQ(output.models.size(), 1u);
  EXPECT_EQ(output.models[0].cam_from_world.size(), 40u);
  EXPECT_NEAR(output.models[0].sigma0_px, 0.3, 0.015);
  EXPECT_LT(DeviationFromTruth(b, output.models[0]).center, 3.5e-3);
}

TEST(Mapping, PlanarObject) {
  SyntheticOptions o;
  o.object = Object::kPlane;
  o.noise_px = 0.3;
  const SyntheticBlock b = MakeSyntheticBlock(o);
  const Output output = Map(b);
  ASSERT_EQ(output.models.size(), 1u);
  EXPECT_EQ(output.models[0].cam_from_world.size(), 8u);
  EXPECT_LT(DeviationFromTruth(b, output.models[0]).center, 2e-3);
}

TEST(Mapping, DistortedCamera) {
  SyntheticOptions o;
  o.camera.kind = CameraModelKind::kOpenCv;
  o.camera.k1 = -0.11, o.camera.k2 = 0.06, o.camera.p1 = 8e-4, o.camera.p2 = -5e-4;
  const SyntheticBlock b = MakeSyntheticBlock(o);
  const Output output = Map(b);
  ASSERT_EQ(output.models.size(), 1u);
  EXPECT_EQ(output.models[0].cam_from_world.size(), 8u);
  EXPECT_LT(DeviationFromTruth(b, output.models[0]).center, 1e-6);
}

TEST(Mapping, PairsKnownByTheFundamentalMatrixOnlyAreEnough) {
  SyntheticOptions o;
  o.noise_px = 0.3;
  SyntheticBlock b = MakeSyntheticBlock(o);
  Eigen::Matrix3d k;
  k << o.camera.fx, 0, o.camera.cx, 0, o.camera.fy, o.camera.cy, 0, 0, 1;
  for (TwoViewGeometry& g : b.pairs) {
    const Eigen::Vector3d t = g.second_from_first.translation;
    Eigen::Matrix3d cross;
    cross << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
    g.matrix = k.transpose().inverse() * cross * g.second_from_first.RotationMatrix() * k.inverse();
    g.matrix /= -g.matrix.norm();  // F has no scale and no sign
    g.model = TwoViewModel::kFundamental;
    g.second_from_first = Rigid3();
    g.median_angle_rad = 0;
  }
  const Output output = Map(b);
  ASSERT_EQ(output.models.size(), 1u);
  EXPECT_EQ(output.models[0].cam_from_world.size(), 8u);
  EXPECT_LT(DeviationFromTruth(b, output.models[0]).center, 1e-3);
}

TEST(Mapping, TwoImagesAlone) {
  SyntheticOptions o;
  o.images = 2;
  const Output output = Map(MakeSyntheticBlock(o));
  ASSERT_EQ(output.models.size(), 1u);
  EXPECT_EQ(output.models[0].cam_from_world.size(), 2u);
  EXPECT_GT(output.models[0].points.size(), 500u);
}

TEST(Mapping, RotationAloneOrientsNothingAndSaysWhy) {
  SyntheticOptions o;
  o.layout = Layout::kRotation;
  o.images = 4;
  o.noise_px = 0.3;
  const Output output = Map(MakeSyntheticBlock(o));
  EXPECT_TRUE(output.models.empty());
  ASSERT_EQ(output.unoriented.size(), 4u);
  EXPECT_NE(output.unoriented[0].reason.find("parallax"), std::string::npos) << output.unoriented[0].reason;
}

TEST(Mapping, ImagesWithoutMatchesAreNamedWithAReason) {
  SyntheticBlock b = MakeSyntheticBlock({});
  Image lonely = b.block.images[0];
  lonely.id = ImageId(8);
  lonely.name = "lonely.jpg";
  b.block.images.push_back(lonely);
  b.keypoints.emplace_back();
  b.colors.emplace_back();
  TwoViewGeometry rejected;
  rejected.pair = {ImageId(3), ImageId(8)};
  rejected.reason = RejectionReason::kTooFewMatches;
  rejected.matches = 9;
  b.pairs.push_back(rejected);
  const Output output = Map(b);
  ASSERT_EQ(output.models.size(), 1u);
  ASSERT_EQ(output.unoriented.size(), 1u);
  EXPECT_EQ(output.unoriented[0].image, ImageId(8));
  EXPECT_NE(output.unoriented[0].reason.find("9 unverified with IMG_3.jpg"), std::string::npos)
      << output.unoriented[0].reason;
}

TEST(Mapping, NothingComesOfNothing) {
  SyntheticBlock none;
  EXPECT_TRUE(Map(none).models.empty());
  SyntheticOptions o;
  o.images = 1;
  const Output one = Map(MakeSyntheticBlock(o));
  EXPECT_TRUE(one.models.empty());
  EXPECT_EQ(one.unoriented.size(), 1u);
}

bool SameBits(const Model& a, const Model& b) {
  const auto same = [](const auto& u, const auto& v) {
    for (Eigen::Index i = 0; i < u.size(); ++i)
      if (std::bit_cast<std::uint64_t>(u[i]) != std::bit_cast<std::uint64_t>(v[i])) return false;
    return true;
  };
  if (a.cam_from_world.size() != b.cam_from_world.size() || a.points.size() != b.points.size()) return false;
  for (auto i = a.cam_from_world.begin(), j = b.cam_from_world.begin(); i != a.cam_from_world.end(); ++i, ++j)
    if (i->first != j->first || !same(i->second.rotation.coeffs(), j->second.rotation.coeffs()) ||
        !same(i->second.translation, j->second.translation))
      return false;
  for (std::size_t p = 0; p < a.points.size(); ++p)
    if (!same(a.points[p].position, b.points[p].position) ||
        a.points[p].observations.size() != b.points[p].observations.size())
      return false;
  return true;
}

TEST(Mapping, BytesDependNeitherOnTheOrderOfInputNorOnTheRun) {
  SyntheticOptions o;
  o.noise_px = 0.5;
  o.wrong_share = 0.05;
  o.points = 600;
  SyntheticBlock b = MakeSyntheticBlock(o);
  const Output first = Map(b);
  // Another state of the heap, other orders.
  const std::vector<std::vector<double>> ballast(1000, std::vector<double>(137));
  std::reverse(b.pairs.begin(), b.pairs.end());
  std::rotate(b.tracks.begin(), b.tracks.begin() + 100, b.tracks.end());
  const Output second = Map(b);
  ASSERT_EQ(first.models.size(), 1u);
  ASSERT_EQ(second.models.size(), 1u);
  EXPECT_TRUE(SameBits(first.models[0], second.models[0]));
}

/// Cuts all tracks to two rays: the most points that as many rays can make.
void CutTracksInTwo(SyntheticBlock& b) {
  std::vector<Track> tracks;
  std::vector<std::uint32_t> point_of_track;
  for (std::size_t t = 0; t < b.tracks.size(); ++t) {
    const auto& elements = b.tracks[t].elements;
    // Every fourth stays whole: pairs alone would not hang together.
    const std::size_t length = t % 4 == 0 ? elements.size() : 2;
    for (std::size_t begin = 0; begin + 1 < elements.size(); begin += length) {
      const auto first = elements.begin() + static_cast<std::ptrdiff_t>(begin);
      Track& track = tracks.emplace_back();
      track.elements.assign(first, first + static_cast<std::ptrdiff_t>(std::min(length, elements.size() - begin)));
      point_of_track.push_back(b.point_of_track[t]);
    }
  }
  b.tracks = std::move(tracks);
  b.point_of_track = std::move(point_of_track);
}

/// Growth of the high-water mark, in a process of its own because the mark never falls. Bytes; 0 = it failed.
std::uint64_t PeakBytesOfMapping(const SyntheticBlock& b) {
  int pipe_ends[2];
  if (pipe(pipe_ends) != 0) return 0;
  const pid_t child = fork();
  if (child == 0) {
    malloc_trim(0);
    rusage before{}, after{};
    getrusage(RUSAGE_SELF, &before);
    const bool whole = Map(b).models.size() == 1;
    getrusage(RUSAGE_SELF, &after);
    const std::uint64_t grown = whole ? static_cast<std::uint64_t>(after.ru_maxrss - before.ru_maxrss) * 1024 : 0;
    _exit(write(pipe_ends[1], &grown, sizeof grown) == sizeof grown ? 0 : 1);
  }
  std::uint64_t grown = 0;
  if (read(pipe_ends[0], &grown, sizeof grown) != static_cast<ssize_t>(sizeof grown)) grown = 0;
  waitpid(child, nullptr, 0);
  close(pipe_ends[0]);
  close(pipe_ends[1]);
  return grown;
}

TEST(Mapping, TheEstimateIsAnUpperBoundOfTheMemory) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "a sanitizer's own memory would be measured";
#endif
  SyntheticOptions o;
  o.layout = Layout::kRing;
  o.object = Object::kSphere;
  o.images = 16;
  o.points = 20000;
  o.noise_px = 0.3;
  SyntheticBlock b = MakeSyntheticBlock(o);
  for (const bool cut : {false, true}) {
    if (cut) CutTracksInTwo(b);
    std::size_t features = 0, matches = 0;
    for (const auto& keypoints : b.keypoints) features += keypoints.size();
    for (const auto& pair : b.pairs) matches += pair.inliers.size();
    const std::uint64_t measured = PeakBytesOfMapping(b);
    ASSERT_GT(measured, 0u);
    const double ratio = static_cast<double>(mapping::Estimate(b.block.images.size(), features, matches).peak_bytes) /
                         static_cast<double>(measured);
    RecordProperty(cut ? "short_tracks" : "long_tracks", std::to_string(ratio));
    EXPECT_GE(ratio, 1.05) << measured;
    EXPECT_LE(ratio, 2.5) << measured;
  }
}

TEST(Mapping, StopsWhenAsked) {
  class StoppingContext final : public RunContext {
   public:
    explicit StoppingContext(int polls) : polls_(polls) {}
    bool StopRequested() const override { return --polls_ < 0; }
    std::uint64_t Seed() const override { return 5; }
    void ParallelFor(std::size_t n, std::size_t, const std::function<void(std::size_t, std::size_t)>& fn) override {
      fn(0, n);
    }
    void ReportProgress(double) override {}

   private:
    mutable int polls_;
  };
  const SyntheticBlock b = MakeSyntheticBlock({});
  for (const int polls : {0, 1, 5, 20}) {
    StoppingContext context(polls);
    EXPECT_THROW(mapping::Run({b.block, b.keypoints, b.colors, b.pairs, b.tracks}, {}, context), Cancelled) << polls;
  }
}

}  // namespace
}  // namespace rilievo
