// The bundle adjustment against finite differences, Ceres' automatic derivatives, exact truth and its own bookkeeping.
#include "stages/adjustment/adjustment.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <gtest/gtest.h>

#include <cmath>

#include "stages/adjustment/reprojection.h"
#include "tests/support/synthetic_block.h"

namespace rilievo {
namespace {

using adjustment::Loss;
using adjustment::Options;
using adjustment::PoseManifold;
using adjustment::Reprojection;
using adjustment::Summary;
using test::MakeSyntheticBlock;
using test::SyntheticBlock;
using test::SyntheticOptions;

CameraModel FullCamera() {
  return {.kind = CameraModelKind::kFullOpenCv,
          .fx = 1500,
          .fy = 1530,
          .cx = 760,
          .cy = 490,
          .k1 = -0.12,
          .k2 = 0.07,
          .p1 = 8e-4,
          .p2 = -6e-4,
          .k3 = 0.01,
          .k4 = 0.02,
          .k5 = -0.01,
          .k6 = 0.003};
}

/// The model of a synthetic block with its true poses and points.
Model TrueModel(const SyntheticBlock& b) {
  Model model;
  for (std::uint32_t i = 0; i < b.cam_from_world.size(); ++i) model.cam_from_world[ImageId(i)] = b.cam_from_world[i];
  for (std::size_t t = 0; t < b.tracks.size(); ++t) {
    Point point;
    point.position = b.points[t];
    for (const FeatureRef& e : b.tracks[t].elements)
      point.observations.push_back({e, b.keypoints[e.image.value][e.feature].Position(), Eigen::Vector2d::Zero()});
    model.points.push_back(point);
  }
  return model;
}

Model Disturbed(Model model, double size, std::uint64_t seed) {
  Rng rng(seed);
  const auto random = [&] { return Eigen::Vector3d(size * rng.Normal(), size * rng.Normal(), size * rng.Normal()); };
  for (auto& [id, pose] : model.cam_from_world) {
    const Eigen::Vector3d w = random();
    pose = Rigid3(Eigen::Quaterniond(1, w.x() / 2, w.y() / 2, w.z() / 2).normalized() * pose.rotation,
                  pose.translation + random());
  }
  for (Point& point : model.points) point.position += random();
  return model;
}

Options Strict() {
  Options options;
  options.max_iterations = 100;
  options.function_tolerance = 1e-14;
  return options;
}

TEST(Reprojection, DerivativesMatchFiniteDifferences) {
  Rng rng(2);
  const CameraModel plain{.fx = 1500, .fy = 1530, .cx = 760, .cy = 490}, full = FullCamera();
  const PoseManifold manifold;
  for (int i = 0; i < 200; ++i) {
    const CameraModel& camera = i % 2 == 0 ? plain : full;
    const Reprojection cost(camera, {700, 500});
    const Rigid3 pose(Eigen::Quaterniond(rng.Normal(), rng.Normal(), rng.Normal(), rng.Normal()),
                      Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal()));
    double x[7];
    Eigen::Map<Eigen::Vector4d>(x, 4) = pose.rotation.coeffs();
    Eigen::Map<Eigen::Vector3d>(x + 4, 3) = pose.translation;
    Eigen::Vector3d point = pose.Inverse() * Eigen::Vector3d(rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(2, 4));
    const double* parameters[] = {x, point.data()};
    double residual[2], jp[14], jx[6], plus[42];
    double* jacobians[] = {jp, jx};
    ASSERT_TRUE(cost.Evaluate(parameters, residual, jacobians));
    manifold.PlusJacobian(x, plus);
    const Eigen::Matrix<double, 2, 6> analytic_pose = Eigen::Map<Eigen::Matrix<double, 2, 7, Eigen::RowMajor>>(jp) *
                                                      Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>>(plus);
    const Eigen::Matrix<double, 2, 3> analytic_point = Eigen::Map<Eigen::Matrix<double, 2, 3, Eigen::RowMajor>>(jx);
    constexpr double h = 1e-6;
    const auto at_pose = [&](int k, double step) {
      double delta[6] = {}, moved[7];
      delta[k] = step;
      manifold.Plus(x, delta, moved);
      const double* p[] = {moved, point.data()};
      Eigen::Vector2d r;
      cost.Evaluate(p, r.data(), nullptr);
      return r;
    };
    const auto at_point = [&](int k, double step) {
      Eigen::Vector3d moved = point;
      moved[k] += step;
      const double* p[] = {x, moved.data()};
      Eigen::Vector2d r;
      cost.Evaluate(p, r.data(), nullptr);
      return r;
    };
    for (int k = 0; k < 6; ++k)
      EXPECT_LT((((at_pose(k, h) - at_pose(k, -h)) / (2 * h)) - analytic_pose.col(k)).norm(), 2e-3) << k;
    for (int k = 0; k < 3; ++k)
      EXPECT_LT((((at_point(k, h) - at_point(k, -h)) / (2 * h)) - analytic_point.col(k)).norm(), 2e-3) << k;
  }
}

TEST(Reprojection, PlusAndMinusAreInverse) {
  Rng rng(3);
  const PoseManifold manifold, held(4);
  for (int i = 0; i < 100; ++i) {
    double x[7], y[7], delta[6], back[6];
    Eigen::Map<Eigen::Vector4d>(x, 4) =
        Eigen::Vector4d(rng.Normal(), rng.Normal(), rng.Normal(), rng.Normal()).normalized();
    for (int k = 4; k < 7; ++k) x[k] = rng.Normal();
    for (double& d : delta) d = 0.3 * rng.Normal();
    manifold.Plus(x, delta, y);
    manifold.Minus(y, x, back);
    for (int k = 0; k < 6; ++k) EXPECT_NEAR(back[k], delta[k], 1e-12);
    held.Plus(x, delta, y);
    EXPECT_EQ(y[5], x[5]);
  }
}

/// The same residual with automatic derivatives and Ceres' own quaternion manifold: an independent solution.
struct AutoReprojection {
  CameraModel m;
  Eigen::Vector2d measured;
  template <class T>
  bool operator()(const T* q, const T* t, const T* point, T* r) const {
    T x[3];
    const T wxyz[4] = {q[3], q[0], q[1], q[2]};
    ceres::QuaternionRotatePoint(wxyz, point, x);
    const T u = (x[0] + t[0]) / (x[2] + t[2]), v = (x[1] + t[1]) / (x[2] + t[2]), r2 = u * u + v * v;
    const T d = (1.0 + r2 * (m.k1 + r2 * (m.k2 + r2 * m.k3))) / (1.0 + r2 * (m.k4 + r2 * (m.k5 + r2 * m.k6)));
    r[0] = m.fx * (u * d + 2.0 * m.p1 * u * v + m.p2 * (r2 + 2.0 * u * u)) + m.cx - measured.x();
    r[1] = m.fy * (v * d + m.p1 * (r2 + 2.0 * v * v) + 2.0 * m.p2 * u * v) + m.cy - measured.y();
    return true;
  }
};

double CostByAutomaticDerivatives(const SyntheticBlock& b, Model model) {
  ceres::Problem problem;
  for (auto& [id, pose] : model.cam_from_world) {
    problem.AddParameterBlock(pose.rotation.coeffs().data(), 4, new ceres::EigenQuaternionManifold);
    problem.AddParameterBlock(pose.translation.data(), 3);
  }
  for (Point& p : model.points)
    for (const Observation& o : p.observations) {
      Rigid3& pose = model.cam_from_world.at(o.feature.image);
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<AutoReprojection, 2, 4, 3, 3>(
                                   new AutoReprojection{b.block.camera_of(o.feature.image).model, o.measured_px}),
                               nullptr, pose.rotation.coeffs().data(), pose.translation.data(), p.position.data());
    }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = 100;
  options.function_tolerance = 1e-14;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return summary.final_cost;
}

TEST(Adjustment, EndsWhereAutomaticDerivativesEnd) {
  SyntheticOptions o;
  o.camera = FullCamera();
  o.images = 5;
  o.points = 150;
  o.noise_px = 0.5;
  const SyntheticBlock b = MakeSyntheticBlock(o);
  Model model = Disturbed(TrueModel(b), 0.01, 4);
  const double expected = CostByAutomaticDerivatives(b, model);
  SerialRunContext context;
  const Summary summary = adjustment::Run(b.block, model, Strict(), context);
  EXPECT_NEAR(summary.final_cost / expected, 1, 1e-9);
  EXPECT_GT(summary.initial_cost, 10 * summary.final_cost);
}

TEST(Adjustment, CountsUnknownsAndRedundancyOfAFreeNetwork) {
  SyntheticOptions o;
  o.images = 6;
  o.points = 300;
  o.noise_px = 0.4;
  const SyntheticBlock b = MakeSyntheticBlock(o);
  Model model = TrueModel(b);
  long rays = 0;
  for (const Point& p : model.points) rays += static_cast<long>(p.observations.size());
  SerialRunContext context;
  for (const bool fix_gauge : {true, false}) {
    Model m = model;
    Options options = Strict();
    options.fix_gauge = fix_gauge;
    const Summary summary = adjustment::Run(b.block, m, options, context);
    EXPECT_TRUE(summary.converged);
    EXPECT_EQ(summary.observations, 2 * rays);
    EXPECT_EQ(summary.unknowns, 6 * 6 + 3 * static_cast<long>(model.points.size()));
    EXPECT_EQ(summary.redundancy, summary.observations - summary.unknowns + 7);
    EXPECT_NEAR(summary.sigma0_px, 0.4, 0.02);
    EXPECT_EQ(m.sigma0_px, summary.sigma0_px);
    double squares = 0;
    for (const Point& p : m.points)
      for (const Observation& obs : p.observations) {
        const auto projected = b.block.cameras[0].model.Project(m.cam_from_world.at(obs.feature.image) * p.position);
        ASSERT_TRUE(projected);
        EXPECT_LT((*projected - obs.measured_px - obs.residual_px).norm(), 1e-9);
        squares += obs.residual_px.squaredNorm();
      }
    EXPECT_NEAR(std::sqrt(squares / static_cast<double>(summary.redundancy)), summary.sigma0_px, 1e-12);
  }
}

TEST(Adjustment, ManyImagesGoThroughTheSparseSolver) {
  SyntheticOptions o;
  o.layout = test::Layout::kRing;
  o.object = test::Object::kSphere;
  o.images = 510;  // one step of the ring is 0.7 deg: neighbours tie each other
  o.points = 60;
  o.noise_px = 0.4;
  o.sequence_window = 1;
  const SyntheticBlock b = MakeSyntheticBlock(o);
  Model model = TrueModel(b);
  // Long tracks fill the reduced system; in pieces they leave it a band.
  std::vector<Point> pieces;
  for (const Point& point : model.points) {
    for (std::size_t at = 0; at + 15 <= point.observations.size(); at += 15) {
      Point piece = point;
      piece.observations.assign(point.observations.begin() + static_cast<std::ptrdiff_t>(at),
                                point.observations.begin() + static_cast<std::ptrdiff_t>(at + 15));
      pieces.push_back(piece);
    }
  }
  model.points = pieces;
  model = Disturbed(model, 0.0005, 5);
  SerialRunContext context;
  const Summary summary = adjustment::Run(b.block, model, {}, context);
  EXPECT_GT(summary.initial_cost, 2 * summary.final_cost);
  EXPECT_NEAR(summary.sigma0_px, 0.4, 0.02);
}

TEST(Adjustment, HeldImagesAndDatumStay) {
  const SyntheticBlock b = MakeSyntheticBlock({});
  const Model start = Disturbed(TrueModel(b), 0.005, 9);
  SerialRunContext context;
  Model free = start;
  adjustment::Run(b.block, free, {}, context);
  EXPECT_LT(free.cam_from_world.at(ImageId(0)).rotation.angularDistance(start.cam_from_world.at(ImageId(0)).rotation),
            1e-15);
  Model local = TrueModel(b);
  const Model truth = local;
  local.cam_from_world.at(ImageId(3)).translation += Eigen::Vector3d(0.01, 0.02, -0.01);
  Options options;
  for (std::uint32_t i = 0; i < 8; ++i)
    if (i != 3) options.fixed_images.insert(ImageId(i));
  options.function_tolerance = 1e-12;
  const Summary summary = adjustment::Run(b.block, local, options, context);
  EXPECT_EQ(summary.redundancy, summary.observations - 6 - 3 * static_cast<long>(truth.points.size()));
  EXPECT_EQ(local.cam_from_world.at(ImageId(2)).translation, truth.cam_from_world.at(ImageId(2)).translation);
  EXPECT_LT((local.cam_from_world.at(ImageId(3)).Center() - truth.cam_from_world.at(ImageId(3)).Center()).norm(), 1e-5);
}

TEST(Adjustment, RobustLossWithstandsWrongRays) {
  SyntheticOptions o;
  o.noise_px = 0.3;
  o.wrong_share = 0.03;
  const SyntheticBlock b = MakeSyntheticBlock(o);
  SerialRunContext context;
  const auto center_error = [&](Loss loss) {
    Model model = TrueModel(b);
    Options options;
    options.loss = loss;
    adjustment::Run(b.block, model, options, context);
    double sum = 0;
    for (const auto& [id, pose] : model.cam_from_world)
      sum += (pose.Center() - b.cam_from_world[id.value].Center()).norm() / 8;
    return sum;
  };
  EXPECT_LT(center_error(Loss::kCauchy), 3e-3);
  EXPECT_GT(center_error(Loss::kLeastSquares), 10 * center_error(Loss::kCauchy));
}

TEST(Adjustment, PoorInputIsNoCrash) {
  SyntheticBlock b = MakeSyntheticBlock({});
  SerialRunContext context;
  Model empty;
  EXPECT_EQ(adjustment::Run(b.block, empty, {}, context).observations, 0);
  Model one;
  one.cam_from_world[ImageId(0)] = b.cam_from_world[0];
  const Summary alone = adjustment::Run(b.block, one, {}, context);
  EXPECT_EQ(alone.redundancy, 0);
  Model truth = TrueModel(b);
  for (Point& p : truth.points)
    std::erase_if(p.observations, [](const Observation& obs) { return obs.feature.image != ImageId(0); });
  std::erase_if(truth.points, [](const Point& p) { return p.observations.empty(); });
  truth.cam_from_world = {{ImageId(0), b.cam_from_world[0]}};
  EXPECT_EQ(adjustment::Run(b.block, truth, {}, context).sigma0_px, 0);
  // A point behind every camera takes no part and says so.
  Model behind = TrueModel(b);
  behind.points[0].position = {0, 0, -50};
  const Summary summary = adjustment::Run(b.block, behind, {}, context);
  EXPECT_GT(summary.redundancy, 0);
  EXPECT_FALSE(behind.points[0].observations[0].residual_px.allFinite());
  EXPECT_LT(summary.sigma0_px, 1e-3);
}

TEST(Adjustment, StopsWhenAsked) {
  class StoppedContext final : public RunContext {
   public:
    bool StopRequested() const override { return polls_++ > 0; }  // not at the door: in the middle
    std::uint64_t Seed() const override { return 0; }
    void ParallelFor(std::size_t, std::size_t, const std::function<void(std::size_t, std::size_t)>&) override {}
    void ReportProgress(double) override {}

   private:
    mutable int polls_ = 0;
  };
  const SyntheticBlock b = MakeSyntheticBlock({});
  Model model = Disturbed(TrueModel(b), 0.01, 1);
  StoppedContext context;
  EXPECT_THROW(adjustment::Run(b.block, model, {}, context), Cancelled);
}

}  // namespace
}  // namespace rilievo
