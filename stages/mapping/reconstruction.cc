// Bookkeeping of a growing model.
#include "stages/mapping/reconstruction.h"

#include "base/check.h"
#include "base/rng.h"
#include "block/io/serialize_common.h"

namespace rilievo::mapping {

Reconstruction::Reconstruction(const TieBlock& ties, std::uint64_t seed)
    : ties_(&ties),
      seed_(seed),
      poses_(ties.NumImages()),
      positions_(ties.NumTracks(), Eigen::Vector3d::Zero()),
      has_point_(ties.NumTracks(), 0),
      used_(ties.rays.size(), 0),
      visible_(ties.NumImages(), 0) {}

std::vector<ImageId> Reconstruction::RegisteredImages() const {
  std::vector<ImageId> images;
  for (std::uint32_t i = 0; i < poses_.size(); ++i)
    if (poses_[i]) images.push_back(ImageId(i));
  return images;
}

void Reconstruction::SetPose(ImageId image, const Rigid3& cam_from_world) {
  auto& pose = poses_[image.value];
  registered_ += !pose.has_value();
  pose = Pose{cam_from_world, CameraPose(cam_from_world)};
}

void Reconstruction::RemoveImage(ImageId image) {
  RILIEVO_CHECK(IsRegistered(image));
  poses_[image.value].reset();
  --registered_;
  for (const std::uint32_t ray : ties_->rays_of_image[image.value]) {
    if (!used_[ray]) continue;
    used_[ray] = 0;
    if (NumUsedRays(ties_->rays[ray].track) < 2) RemovePoint(ties_->rays[ray].track);
  }
}

int Reconstruction::NumUsedRays(std::uint32_t track) const {
  int used = 0;
  for (std::uint32_t ray = ties_->first_ray[track]; ray < ties_->first_ray[track + 1]; ++ray) used += used_[ray];
  return used;
}

std::vector<std::uint32_t> Reconstruction::Tracks() const {
  std::vector<std::uint32_t> tracks;
  tracks.reserve(points_);
  for (std::uint32_t track = 0; track < has_point_.size(); ++track)
    if (has_point_[track]) tracks.push_back(track);
  return tracks;
}

std::uint32_t Reconstruction::NumUsed(ImageId image) const {
  std::uint32_t used = 0;
  for (const std::uint32_t ray : ties_->rays_of_image[image.value]) used += used_[ray];
  return used;
}

RayView Reconstruction::View(std::uint32_t ray) const {
  const TieRay& tie = ties_->rays[ray];
  return {&poses_[tie.image.value]->camera, tie.normalized, ties_->focal_px[tie.image.value]};
}

std::vector<RayView> Reconstruction::UsedViews(std::uint32_t track) const {
  std::vector<RayView> views;
  for (std::uint32_t ray = ties_->first_ray[track]; ray < ties_->first_ray[track + 1]; ++ray)
    if (used_[ray]) views.push_back(View(ray));
  return views;
}

void Reconstruction::RemovePoint(std::uint32_t track) {
  if (!has_point_[track]) return;
  has_point_[track] = 0;
  --points_;
  for (std::uint32_t ray = ties_->first_ray[track]; ray < ties_->first_ray[track + 1]; ++ray) {
    used_[ray] = 0;
    --visible_[ties_->rays[ray].image.value];
  }
}

int Reconstruction::Intersect(std::uint32_t track, const PointTolerance& tolerance) {
  const std::uint32_t begin = ties_->first_ray[track], end = ties_->first_ray[track + 1];
  if (has_point_[track]) {
    int added = 0;
    for (std::uint32_t ray = begin; ray < end; ++ray) {
      if (used_[ray] || !IsRegistered(ties_->rays[ray].image)) continue;
      if (RayResidualPx(View(ray), positions_[track]) > tolerance.max_residual_px) continue;
      used_[ray] = 1;
      ++added;
    }
    return added;
  }
  std::vector<RayView> views;
  std::vector<std::uint32_t> rays;
  for (std::uint32_t ray = begin; ray < end; ++ray) {
    if (!IsRegistered(ties_->rays[ray].image)) continue;
    views.push_back(View(ray));
    rays.push_back(ray);
  }
  const auto found =
      IntersectRobustly(views, {tolerance.max_residual_px, tolerance.min_angle_rad, SeedFor(seed_, track)});
  if (!found) return 0;
  int added = 0;
  for (std::size_t i = 0; i < rays.size(); ++i) added += used_[rays[i]] = found->is_inlier[i];
  positions_[track] = found->position;
  has_point_[track] = 1;
  ++points_;
  for (std::uint32_t ray = begin; ray < end; ++ray) ++visible_[ties_->rays[ray].image.value];
  return added;
}

void Reconstruction::Refine(std::uint32_t track) {
  const auto views = UsedViews(track);
  if (const auto refined = RefineIntersection(views, positions_[track], 5)) positions_[track] = *refined;
}

int Reconstruction::Filter(std::uint32_t track, const PointTolerance& tolerance) {
  int dropped = 0, left = 0;
  for (std::uint32_t ray = ties_->first_ray[track]; ray < ties_->first_ray[track + 1]; ++ray) {
    if (!used_[ray]) continue;
    const bool fits = RayResidualPx(View(ray), positions_[track]) <= tolerance.max_residual_px;
    used_[ray] = fits;
    dropped += !fits;
    left += fits;
  }
  if (left >= 2 && IntersectionAngle(UsedViews(track), positions_[track]) >= tolerance.min_angle_rad) return dropped;
  RemovePoint(track);
  return dropped + left;
}

void Reconstruction::Write(ByteWriter& out) const {
  for (const auto& pose : poses_) {
    out.Put<std::uint8_t>(pose.has_value());
    if (pose) io::PutPose(out, pose->rigid);
  }
  out.PutVector(has_point_);
  out.PutVector(used_);
  for (std::uint32_t track = 0; track < has_point_.size(); ++track)
    if (has_point_[track]) io::PutMatrix(out, positions_[track]);
}

Reconstruction Reconstruction::Read(ByteReader& in, const TieBlock& ties, std::uint64_t seed) {
  Reconstruction r(ties, seed);
  for (std::uint32_t image = 0; image < ties.NumImages(); ++image)
    if (in.Get<std::uint8_t>() != 0) r.SetPose(ImageId(image), io::GetPose(in));
  r.has_point_ = in.GetVector<std::uint8_t>();
  r.used_ = in.GetVector<std::uint8_t>();
  io::Require(r.has_point_.size() == ties.NumTracks() && r.used_.size() == ties.rays.size(), "other tie points");
  for (std::uint32_t track = 0; track < r.has_point_.size(); ++track) {
    if (!r.has_point_[track]) continue;
    r.positions_[track] = io::GetMatrix<3>(in);
    ++r.points_;
    for (std::uint32_t ray = ties.first_ray[track]; ray < ties.first_ray[track + 1]; ++ray)
      ++r.visible_[ties.rays[ray].image.value];
  }
  return r;
}

}  // namespace rilievo::mapping
