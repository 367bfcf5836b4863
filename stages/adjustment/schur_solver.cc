// Levenberg-Marquardt with the points eliminated (SPEC 5.4): N = [U W; W' V], V block-diagonal.
#include "stages/adjustment/schur_solver.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <optional>

#include "stages/adjustment/collinearity.h"

namespace rilievo::adjustment {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Matrix63 = Eigen::Matrix<double, 6, 3>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

/// Parts of the sums: a fixed rule on counts. Each has a reduced system of its own, so large ones are summed in one.
constexpr std::size_t kMostParts = 16, kMostImagesInParts = 64, kPointsPerPart = 256;

std::size_t PartsOf(std::size_t images, std::size_t points) {
  if (images > kMostImagesInParts) return 1;
  return std::clamp<std::size_t>(points / kPointsPerPart, 1, kMostParts);
}

/// Damping of an unknown: its diagonal element over the radius of the trust region (Marquardt 1963), within bounds.
double Damping(double diagonal, double radius) { return std::clamp(diagonal, 1e-6, 1e32) / radius; }

/// A ray's derivatives, weighted.
struct RayTerms {
  Eigen::Matrix<double, 2, 6> by_pose;
  Eigen::Matrix<double, 2, 3> by_point;
};

struct PointTerms {
  Eigen::Matrix3d v;         ///< sum of by_point' by_point
  Eigen::Vector3d gradient;  ///< sum of by_point' residual
  Eigen::Matrix3d inverse;   ///< of v, damped; zero where it is singular: such a point stays
};

/// What a part of the points adds to the system of the poses; blocks on and below the diagonal.
struct PartSums {
  std::vector<Matrix6> u;
  std::vector<Vector6> gradient;
  Eigen::MatrixXd reduced;
  Eigen::VectorXd right;
  double cost = 0, decrease = 0;
};

class Solver {
 public:
  Solver(BundleProblem& problem, const BundleOptions& options, RunContext& context)
      : p_(problem), options_(options), context_(context), unknown_(problem.images.size(), -1) {
    for (std::size_t i = 0; i < p_.images.size(); ++i)
      if (!p_.images[i].is_fixed) unknown_[i] = static_cast<int>(free_.size()), free_.push_back(i);
    parts_.resize(PartsOf(free_.size(), p_.points.size()));
    rays_.resize(p_.rays.size());
    points_.resize(p_.points.size());
    for (PartSums& part : parts_) {
      part.u.resize(free_.size());
      part.gradient.resize(free_.size());
    }
  }

  BundleSummary Run() {
    BundleSummary summary;
    if (free_.empty() && p_.fix_points) return summary;
    double cost = Linearize();
    double radius = 1e4, shrink = 2;
    while (summary.iterations < options_.max_iterations && radius > 1e-20) {
      context_.ThrowIfStopped();
      ++summary.iterations;
      const auto step = Step(radius);
      if (step && step->decrease <= 1e-15 * cost) {
        summary.converged = true;
        break;
      }
      if (step) {
        State moved = Moved(*step);
        const double moved_cost = Cost(moved);
        const double gain = (cost - moved_cost) / step->decrease;
        if (gain > 1e-3) {
          Accept(std::move(moved));
          radius = std::min(1e16, radius / std::max(1.0 / 3, 1 - std::pow(2 * gain - 1, 3)));
          shrink = 2;
          const bool is_last = cost - moved_cost < options_.function_tolerance * cost;
          cost = is_last ? moved_cost : Linearize();
          if (!is_last) continue;
          summary.converged = true;
          break;
        }
        // Rounding is all that is left to gain.
        if (std::fabs(cost - moved_cost) <= 1e-14 * cost) {
          summary.converged = true;
          break;
        }
      }
      radius /= shrink;
      shrink *= 2;
    }
    return summary;
  }

 private:
  struct StepOf {
    Eigen::VectorXd poses;
    std::vector<Eigen::Vector3d> points;
    double decrease = 0;  ///< of the cost, as the linear model has it
  };
  struct State {
    std::vector<BundleImage> images;
    std::vector<Eigen::Vector3d> points;
  };

  /// Runs fn(part, first point, end) for all parts.
  template <class F>
  void ForParts(F&& fn) {
    const std::size_t count = parts_.size(), n = p_.points.size();
    context_.ParallelFor(count, 1, [&](std::size_t begin, std::size_t end) {
      for (std::size_t k = begin; k < end; ++k) fn(parts_[k], n * k / count, n * (k + 1) / count);
    });
  }

  static std::vector<Eigen::Matrix3d> Rotations(const std::vector<BundleImage>& images) {
    std::vector<Eigen::Matrix3d> rotations;
    rotations.reserve(images.size());
    for (const BundleImage& image : images) rotations.push_back(image.rotation.toRotationMatrix());
    return rotations;
  }

  /// Derivatives at the present state; its cost.
  double Linearize() {
    const std::vector<Eigen::Matrix3d> rotations = Rotations(p_.images);
    ForParts([&](PartSums& part, std::size_t begin, std::size_t end) {
      part.cost = 0;
      std::fill(part.u.begin(), part.u.end(), Matrix6::Zero());
      std::fill(part.gradient.begin(), part.gradient.end(), Vector6::Zero());
      for (std::size_t j = begin; j < end; ++j) LinearizePoint(rotations, j, part);
    });
    double cost = 0;
    for (std::size_t k = 0; k < parts_.size(); ++k) {
      cost += parts_[k].cost;
      if (k == 0) continue;
      for (std::size_t i = 0; i < free_.size(); ++i) {
        parts_[0].u[i] += parts_[k].u[i];
        parts_[0].gradient[i] += parts_[k].gradient[i];
      }
    }
    return 0.5 * cost;
  }

  void LinearizePoint(const std::vector<Eigen::Matrix3d>& rotations, std::size_t j, PartSums& part) {
    PointTerms& point = points_[j];
    point.v.setZero();
    point.gradient.setZero();
    for (std::size_t k = p_.first_ray[j]; k < p_.first_ray[j + 1]; ++k) {
      const BundleRay& ray = p_.rays[k];
      const BundleImage& image = p_.images[ray.image];
      const Collinearity c =
          adjustment::Linearize(*image.camera, rotations[ray.image], image.translation, p_.points[j], ray.measured_px);
      const LossValue loss = Evaluate(options_.loss, options_.loss_scale_px, c.residual_px.squaredNorm());
      part.cost += loss.rho;
      const double root = std::sqrt(loss.weight);
      const Eigen::Vector2d residual = root * c.residual_px;
      RayTerms& terms = rays_[k];
      if (!p_.fix_points) {
        terms.by_point = root * (c.by_camera_point * rotations[ray.image]);
        point.v += terms.by_point.transpose() * terms.by_point;
        point.gradient += terms.by_point.transpose() * residual;
      }
      const int unknown = unknown_[ray.image];
      if (unknown < 0) continue;
      terms.by_pose = root * ByPose(c);
      if (image.held >= 0) terms.by_pose.col(image.held).setZero();
      part.u[static_cast<std::size_t>(unknown)] += terms.by_pose.transpose() * terms.by_pose;
      part.gradient[static_cast<std::size_t>(unknown)] += terms.by_pose.transpose() * residual;
    }
  }

  /// Eliminates a point: its part of S = U - W V^-1 W' and of the right side.
  void ReducePoint(std::size_t j, double radius, PartSums& part) {
    PointTerms& point = points_[j];
    Eigen::Matrix3d v = point.v;
    for (int d = 0; d < 3; ++d) v(d, d) += Damping(point.v(d, d), radius);
    const double determinant = v.determinant();
    point.inverse = determinant > 0 ? Eigen::Matrix3d(v.inverse()) : Eigen::Matrix3d::Zero();
    if (!point.inverse.allFinite()) point.inverse.setZero();
    const Eigen::Vector3d shift = point.inverse * point.gradient;
    for (std::size_t k = p_.first_ray[j]; k < p_.first_ray[j + 1]; ++k) {
      const int a = unknown_[p_.rays[k].image];
      if (a < 0) continue;
      const Matrix63 w = rays_[k].by_pose.transpose() * rays_[k].by_point;
      const Matrix63 wv = w * point.inverse;
      part.right.segment<6>(6 * a) += w * shift;
      for (std::size_t l = p_.first_ray[j]; l < p_.first_ray[j + 1]; ++l) {
        const int b = unknown_[p_.rays[l].image];
        if (b < 0 || b > a) continue;
        // wv w_b' with w_b = by_pose' by_point: two products with the factors of w_b are fewer than one with w_b.
        part.reduced.block<6, 6>(6 * a, 6 * b) -= (wv * rays_[l].by_point.transpose()) * rays_[l].by_pose;
      }
    }
  }

  /// The damped step, or none where the reduced system is not positive definite.
  std::optional<StepOf> Step(double radius) {
    const auto size = static_cast<Eigen::Index>(6 * free_.size());
    if (!p_.fix_points) {
      ForParts([&](PartSums& part, std::size_t begin, std::size_t end) {
        part.reduced.setZero(size, size);
        part.right.setZero(size);
        for (std::size_t j = begin; j < end; ++j) ReducePoint(j, radius, part);
      });
    } else {
      parts_[0].reduced.setZero(size, size);
      parts_[0].right.setZero(size);
    }
    PartSums& sum = parts_[0];
    for (std::size_t k = 1; k < parts_.size() && !p_.fix_points; ++k) {
      sum.reduced += parts_[k].reduced;
      sum.right += parts_[k].right;
    }
    for (std::size_t i = 0; i < free_.size(); ++i) {
      const auto at = static_cast<Eigen::Index>(6 * i);
      Matrix6 u = sum.u[i];
      for (int d = 0; d < 6; ++d) u(d, d) += Damping(sum.u[i](d, d), radius);
      sum.reduced.block<6, 6>(at, at) += u;
      sum.right.segment<6>(at) -= sum.gradient[i];
    }
    StepOf step;
    if (size > 0) {
      const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>, Eigen::Lower> factor(sum.reduced);  // in place
      if (factor.info() != Eigen::Success) return std::nullopt;
      step.poses = factor.solve(sum.right);
      if (!step.poses.allFinite()) return std::nullopt;
    }
    BackSubstitute(radius, step);
    return step;
  }

  /// Steps of the points, and the decrease 1/2 sum of step (damping step - gradient).
  void BackSubstitute(double radius, StepOf& step) {
    step.points.assign(p_.points.size(), Eigen::Vector3d::Zero());
    double sum = 0;
    for (std::size_t i = 0; i < free_.size(); ++i) {
      const Vector6 s = step.poses.segment<6>(static_cast<Eigen::Index>(6 * i));
      for (int d = 0; d < 6; ++d)
        sum += s[d] * (Damping(parts_[0].u[i](d, d), radius) * s[d] - parts_[0].gradient[i][d]);
    }
    if (!p_.fix_points) {
      ForParts([&](PartSums& part, std::size_t begin, std::size_t end) {
        part.decrease = 0;
        for (std::size_t j = begin; j < end; ++j) {
          const PointTerms& point = points_[j];
          Eigen::Vector3d right = -point.gradient;
          for (std::size_t k = p_.first_ray[j]; k < p_.first_ray[j + 1]; ++k) {
            const int a = unknown_[p_.rays[k].image];
            if (a >= 0) right -= rays_[k].by_point.transpose() * (rays_[k].by_pose * step.poses.segment<6>(6 * a));
          }
          const Eigen::Vector3d s = step.points[j] = point.inverse * right;
          for (int d = 0; d < 3; ++d)
            part.decrease += s[d] * (Damping(point.v(d, d), radius) * s[d] - point.gradient[d]);
        }
      });
      for (const PartSums& part : parts_) sum += part.decrease;
    }
    step.decrease = 0.5 * sum;
  }

  State Moved(const StepOf& step) const {
    State moved{p_.images, p_.points};
    for (std::size_t i = 0; i < free_.size(); ++i) {
      BundleImage& image = moved.images[free_[i]];
      const Vector6 s = step.poses.segment<6>(static_cast<Eigen::Index>(6 * i));
      image.rotation = (RotationExp(s.head<3>()) * image.rotation).normalized();
      image.translation += s.tail<3>();
    }
    for (std::size_t j = 0; j < moved.points.size(); ++j) moved.points[j] += step.points[j];
    return moved;
  }

  void Accept(State&& moved) {
    p_.images = std::move(moved.images);
    p_.points = std::move(moved.points);
  }

  double Cost(const State& state) {
    const std::vector<Eigen::Matrix3d> rotations = Rotations(state.images);
    ForParts([&](PartSums& part, std::size_t begin, std::size_t end) {
      part.cost = 0;
      for (std::size_t j = begin; j < end; ++j) {
        for (std::size_t k = p_.first_ray[j]; k < p_.first_ray[j + 1]; ++k) {
          const BundleRay& ray = p_.rays[k];
          const BundleImage& image = state.images[ray.image];
          const Eigen::Vector2d residual =
              ResidualPx(*image.camera, rotations[ray.image], image.translation, state.points[j], ray.measured_px);
          part.cost += Evaluate(options_.loss, options_.loss_scale_px, residual.squaredNorm()).rho;
        }
      }
    });
    double cost = 0;
    for (const PartSums& part : parts_) cost += part.cost;
    return 0.5 * cost;
  }

  BundleProblem& p_;
  const BundleOptions& options_;
  RunContext& context_;
  std::vector<int> unknown_;       ///< by image: number among the free ones, or -1
  std::vector<std::size_t> free_;  ///< free images
  std::vector<PartSums> parts_;    ///< the first also holds the merged sums
  std::vector<RayTerms> rays_;
  std::vector<PointTerms> points_;
};

}  // namespace

BundleSummary SolveBundle(BundleProblem& problem, const BundleOptions& options, RunContext& context) {
  return Solver(problem, options, context).Run();
}

std::size_t SolveBundleBytes(std::size_t images, std::size_t points, std::size_t rays) {
  constexpr std::size_t kPose = sizeof(BundleImage) + sizeof(Eigen::Matrix3d), kBlock = 36 * sizeof(double);
  const std::size_t parts = PartsOf(images, points);
  return rays * sizeof(RayTerms) + points * (sizeof(PointTerms) + 2 * sizeof(Eigen::Vector3d)) + 2 * images * kPose +
         parts * (images * (images + 1) * kBlock + images * 100) + (1 << 16);
}

}  // namespace rilievo::adjustment
