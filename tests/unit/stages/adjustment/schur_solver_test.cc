// The reduced system's solver against Ceres, for every loss and what may be held, and its bytes for any order of work.
#include <gtest/gtest.h>

#include <cstring>

#include "stages/adjustment/adjustment.h"
#include "tests/support/synthetic_block.h"

namespace rilievo {
namespace {

using adjustment::Loss;
using adjustment::Method;
using adjustment::Options;

/// A block with noise and wrong rays, its poses and points off by a hundredth.
struct Start {
  test::SyntheticBlock b;
  Model model;
};

Start MakeStart(int images, int points) {
  test::SyntheticOptions o;
  o.images = images;
  o.points = points;
  o.noise_px = 0.4;
  o.wrong_share = 0.01;
  o.camera.kind = CameraModelKind::kOpenCv;
  o.camera.k1 = -0.08;
  o.camera.p1 = 5e-4;
  Start start{test::MakeSyntheticBlock(o), {}};
  const test::SyntheticBlock& b = start.b;
  Rng rng(11);
  const auto small = [&] { return Eigen::Vector3d(0.01 * rng.Normal(), 0.01 * rng.Normal(), 0.01 * rng.Normal()); };
  for (std::uint32_t i = 0; i < b.cam_from_world.size(); ++i) {
    const Eigen::Vector3d w = small();
    start.model.cam_from_world[ImageId(i)] =
        Rigid3(Eigen::Quaterniond(1, w.x() / 2, w.y() / 2, w.z() / 2).normalized() * b.cam_from_world[i].rotation,
               b.cam_from_world[i].translation + small());
  }
  for (std::size_t t = 0; t < b.tracks.size(); ++t) {
    Point& point = start.model.points.emplace_back();
    point.position = b.points[t] + small();
    for (const FeatureRef& e : b.tracks[t].elements)
      point.observations.push_back({e, b.keypoints[e.image.value][e.feature].Position(), Eigen::Vector2d::Zero()});
  }
  return start;
}

struct Case {
  Loss loss;
  bool fix_points;
  std::set<ImageId> fixed;
};

class ReducedSystemCases : public testing::TestWithParam<int> {
 protected:
  Case Given() const {
    const std::vector<Case> cases = {{Loss::kLeastSquares, false, {}},
                                     {Loss::kHuber, false, {}},
                                     {Loss::kCauchy, false, {}},
                                     {Loss::kCauchy, true, {}},
                                     {Loss::kHuber, false, {ImageId(1), ImageId(4)}},
                                     {Loss::kLeastSquares, false, {ImageId(2)}}};
    return cases[static_cast<std::size_t>(GetParam())];
  }
};

TEST_P(ReducedSystemCases, EndsWhereCeresEnds) {
  const Start start = MakeStart(7, 400);
  const Case given = Given();
  Options options;
  options.loss = given.loss;
  options.fix_points = given.fix_points;
  options.fixed_images = given.fixed;
  options.max_iterations = 300;
  options.function_tolerance = 1e-13;
  Model models[2] = {start.model, start.model};
  adjustment::Summary summaries[2];
  SerialRunContext context;
  for (const int k : {0, 1}) {
    options.method = k == 0 ? Method::kReduced : Method::kCeres;
    summaries[k] = adjustment::Run(start.b.block, models[k], options, context);
  }
  EXPECT_TRUE(summaries[0].converged);
  EXPECT_LT(summaries[0].final_cost, summaries[0].initial_cost);
  EXPECT_NEAR(summaries[0].final_cost / summaries[1].final_cost, 1, 1e-6);
  EXPECT_EQ(summaries[0].redundancy, summaries[1].redundancy);
  for (const auto& [id, pose] : models[0].cam_from_world) {
    EXPECT_LT((pose.Center() - models[1].cam_from_world.at(id).Center()).norm(), 1e-5) << id.value;
    if (given.fixed.contains(id)) {
      EXPECT_LT((pose.Center() - start.model.cam_from_world.at(id).Center()).norm(), 1e-12) << id.value;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, ReducedSystemCases, testing::Range(0, 6));

/// Works through a loop backwards, in pieces: an order that threads might take.
class BackwardContext final : public RunContext {
 public:
  bool StopRequested() const override { return false; }
  std::uint64_t Seed() const override { return 0; }
  void ParallelFor(std::size_t n, std::size_t grain, const std::function<void(std::size_t, std::size_t)>& fn) override {
    for (std::size_t end = n; end > 0;) {
      const std::size_t begin = end > grain ? end - grain : 0;
      fn(begin, end);
      end = begin;
      ++pieces;
    }
  }
  void ReportProgress(double) override {}
  std::size_t pieces = 0;
};

TEST(ReducedSystem, TheOrderOfWorkDoesNotShow) {
  const Start start = MakeStart(6, 1500);  // several parts
  Options options;
  options.loss = Loss::kCauchy;
  options.method = Method::kReduced;
  Model forward = start.model, backward = start.model;
  SerialRunContext serial;
  BackwardContext reversed;
  const auto a = adjustment::Run(start.b.block, forward, options, serial);
  const auto b = adjustment::Run(start.b.block, backward, options, reversed);
  EXPECT_GT(reversed.pieces, 4U * static_cast<std::size_t>(b.iterations));
  EXPECT_EQ(a.final_cost, b.final_cost);
  for (std::size_t j = 0; j < forward.points.size(); ++j)
    ASSERT_EQ(std::memcmp(forward.points[j].position.data(), backward.points[j].position.data(), 24), 0) << j;
}

TEST(ReducedSystem, APointOfOneRayStaysFinite) {
  Start start = MakeStart(6, 200);
  for (std::size_t j = 0; j < 20; ++j) start.model.points[j].observations.resize(1);
  Options options;
  options.method = Method::kReduced;
  SerialRunContext context;
  const auto summary = adjustment::Run(start.b.block, start.model, options, context);
  EXPECT_LT(summary.final_cost, summary.initial_cost);
  for (const Point& point : start.model.points) EXPECT_TRUE(point.position.allFinite());
}

}  // namespace
}  // namespace rilievo
