// Oriented models as bytes: points as parallel arrays.
#include <numeric>

#include "block/io/serialize_block.h"
#include "block/io/serialize_common.h"

namespace rilievo::io {
namespace {

constexpr std::uint32_t kMappingVersion = 1;

void PutPoints(ByteWriter& out, const std::vector<Point>& points) {
  std::vector<double> positions, measured;  // x y z a point; measured x y, residual x y an observation
  std::vector<Rgb> colors;
  std::vector<std::uint32_t> rays;
  std::vector<FeatureRef> features;
  for (const Point& point : points) {
    positions.insert(positions.end(), point.position.data(), point.position.data() + 3);
    colors.push_back(point.color);
    rays.push_back(static_cast<std::uint32_t>(point.observations.size()));
    for (const Observation& o : point.observations) {
      features.push_back(o.feature);
      measured.insert(measured.end(), {o.measured_px.x(), o.measured_px.y(), o.residual_px.x(), o.residual_px.y()});
    }
  }
  out.PutVector(positions);
  out.PutVector(colors);
  out.PutVector(rays);
  out.PutVector(features);
  out.PutVector(measured);
}

std::vector<Point> GetPoints(ByteReader& in) {
  const auto positions = in.GetVector<double>();
  const auto colors = in.GetVector<Rgb>();
  const auto rays = in.GetVector<std::uint32_t>();
  const auto features = in.GetVector<FeatureRef>();
  const auto measured = in.GetVector<double>();
  Require(positions.size() == 3 * rays.size() && colors.size() == rays.size() && measured.size() == 4 * features.size(),
          "arrays of unequal length");
  Require(std::accumulate(rays.begin(), rays.end(), std::uint64_t{0}) == features.size(),
          "points of other length than their rays");
  std::vector<Point> points(rays.size());
  std::size_t next = 0;
  for (std::size_t p = 0; p < points.size(); ++p) {
    points[p].position = {positions[3 * p], positions[3 * p + 1], positions[3 * p + 2]};
    points[p].color = colors[p];
    points[p].observations.resize(rays[p]);
    for (Observation& o : points[p].observations) {
      const double* m = &measured[4 * next];
      o = {features[next++], {m[0], m[1]}, {m[2], m[3]}};
    }
  }
  return points;
}

Model GetModel(ByteReader& in) {
  Model model;
  for (auto n = GetCount(in, 60); n > 0; --n) {
    const ImageId image(in.Get<std::uint32_t>());
    Require(model.cam_from_world.emplace(image, GetPose(in)).second, "an image twice in a model");
  }
  model.points = GetPoints(in);
  model.sigma0_px = in.Get<double>();
  model.redundancy = static_cast<long>(in.Get<std::int64_t>());
  for (const Point& point : model.points)
    for (const Observation& o : point.observations)
      Require(model.cam_from_world.contains(o.feature.image), "a ray of an image that is not in the model");
  return model;
}

}  // namespace

std::vector<std::byte> Serialize(const MappingResult& result) {
  ByteWriter out;
  PutHeader(out, PayloadKind::kMapping, kMappingVersion);
  out.Put<std::uint64_t>(result.models.size());
  for (const Model& model : result.models) {
    out.Put<std::uint64_t>(model.cam_from_world.size());
    for (const auto& [image, pose] : model.cam_from_world) {
      out.Put(image.value);
      PutPose(out, pose);
    }
    PutPoints(out, model.points);
    out.Put(model.sigma0_px);
    out.Put<std::int64_t>(model.redundancy);
  }
  out.Put<std::uint64_t>(result.unoriented.size());
  for (const UnorientedImage& image : result.unoriented) {
    out.Put(image.image.value);
    out.PutString(image.reason);
  }
  return out.Take();
}

MappingResult DeserializeMapping(std::span<const std::byte> bytes) {
  return ReadPayload(bytes, PayloadKind::kMapping, kMappingVersion, [](ByteReader& in) {
    MappingResult result;
    for (auto n = GetCount(in, 64); n > 0; --n) result.models.push_back(GetModel(in));
    result.unoriented.resize(GetCount(in, 12));
    for (UnorientedImage& image : result.unoriented) {
      image.image = ImageId(in.Get<std::uint32_t>());
      image.reason = in.GetString();
    }
    return result;
  });
}

}  // namespace rilievo::io
