// The learnt projections: orthonormal, and nearly the best ones for images that they were not learnt from.
#include "stages/features/projection.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <string>
#include <vector>

#include "base/run_context.h"
#include "simulation/renderer.h"
#include "stages/features/features.h"
#include "stages/features/gloh.h"
#include "stages/features/pca_sift.h"
#include "stages/features/sift.h"
#include "tests/support/reference_descriptors.h"

namespace rilievo::features {
namespace {

using VectorFunction = void (*)(const SiftKernels&, const Patch&, float, float, float*);

struct Case {
  const char* name;
  const StoredProjection& stored;
  VectorFunction vector;
};

/// Columns: what the features of fresh scenes give to the projection. No seed is one of those learnt from.
Eigen::MatrixXd FreshVectors(const Case& c) {
  std::vector<float> values;
  const auto inputs = static_cast<std::size_t>(c.stored.inputs);
  const Describer describe = [&](const auto& kernels, const auto& patch, float cosine, float sine) {
    values.resize(values.size() + inputs);
    c.vector(kernels, patch, cosine, sine, &values[values.size() - inputs]);
    return Descriptor{};
  };
  SerialRunContext context;
  for (const char* surface : {"relief", "sphere", "statue"}) {
    simulation::SceneOptions scene;
    scene.surface = surface;
    scene.images = 1;
    scene.width_px = 700;
    scene.height_px = 500;
    scene.seed = 9001;
    const GreyImage image = simulation::Renderer(simulation::MakeScene(scene)).RenderGrey(0);
    DetectSift({image}, {-1, {0.015, 6}, 4, describe}, {1 << 20, false, image.width_px, image.height_px},
               ChooseSiftKernels(""), context);
  }
  return Eigen::Map<const Eigen::MatrixXf>(values.data(), c.stored.inputs,
                                           static_cast<Eigen::Index>(values.size() / inputs))
      .cast<double>();
}

class Projections : public testing::TestWithParam<Case> {};

INSTANTIATE_TEST_SUITE_P(Kinds, Projections,
                         testing::Values(Case{"Gloh", kGlohProjection, GlohHistogram},
                                         Case{"PcaSift", kPcaSiftProjection, PcaSiftCoefficients}),
                         [](const auto& kind) { return kind.param.name; });

TEST_P(Projections, AreOrthonormalButForTheirRounding) {
  const StoredProjection& stored = GetParam().stored;
  const Eigen::MatrixXd rows = testing_support::ProjectionRows(stored), products = rows * rows.transpose();
  for (int i = 0; i < stored.outputs; ++i) {
    EXPECT_NEAR(products(i, i), 1, 1e-5);
    for (int j = 0; j < i; ++j) {
      // Each weight is off by at most half a step, evenly; as what is learnt is symmetric, they come in fours with
      // equal errors, which doubles the standard deviation of the sum of their products. Five of those:
      const double step_i = static_cast<double>(stored.scales[i]), step_j = static_cast<double>(stored.scales[j]);
      EXPECT_LT(std::abs(products(i, j)), 5 * 2 * std::hypot(step_i, step_j) / std::sqrt(12.0)) << i << ", " << j;
    }
  }
}

TEST_P(Projections, SeparateFreshFeaturesNearlyAsTheBestOnesWould) {
  const Case& c = GetParam();
  Eigen::MatrixXd vectors = FreshVectors(c);
  ASSERT_GT(vectors.cols(), 3000);
  const Eigen::VectorXd mean = vectors.rowwise().mean();
  vectors.colwise() -= mean;
  const Eigen::MatrixXd covariance = vectors * vectors.transpose() / static_cast<double>(vectors.cols());
  const Eigen::MatrixXd rows = testing_support::ProjectionRows(c.stored), seen = rows * covariance * rows.transpose();

  // What the projection keeps of the variance, and what the best one for just these features would.
  const double kept = seen.trace() / covariance.trace();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(covariance, Eigen::EigenvaluesOnly);
  const double best = solver.eigenvalues().tail(c.stored.outputs).sum() / covariance.trace();
  RecordProperty("kept", std::to_string(kept));
  RecordProperty("at_most", std::to_string(best));
  EXPECT_GT(kept, 0.96 * best);
  EXPECT_GT(kept, 0.85);

  // Components hardly depend on each other, and come by falling variance.
  double sum_sq = 0;
  for (int i = 0; i < c.stored.outputs; ++i)
    for (int j = 0; j < i; ++j) sum_sq += seen(i, j) * seen(i, j) / (seen(i, i) * seen(j, j));
  const double rms = std::sqrt(2 * sum_sq / (c.stored.outputs * (c.stored.outputs - 1)));
  RecordProperty("rms_correlation", std::to_string(rms));
  EXPECT_LT(rms, 0.1);
  for (int i = 6; i < c.stored.outputs; ++i) EXPECT_LT(seen(i, i), 1.2 * seen(i - 6, i - 6)) << i;

  // The offsets are the projected mean.
  const Eigen::VectorXd off = rows * mean - testing_support::ProjectionOffsets(c.stored);
  RecordProperty("mean_off", std::to_string(off.norm()));
  EXPECT_LT(off.norm(), 0.25 * std::sqrt(seen.trace()));
}

}  // namespace
}  // namespace rilievo::features
