// The parameter lists of COLMAP's camera models, in COLMAP's order.
#include "block/io/camera_params.h"

#include <array>
#include <utility>

#include "base/check.h"

namespace rilievo::io {
namespace {

using Member = double CameraModel::*;

/// SIMPLE_ and RADIAL kinds have one focal length: their list starts with fx, which stands for both.
std::span<const Member> Members(CameraModelKind kind) {
  using M = CameraModel;
  static constexpr std::array<Member, 5> kOneFocal{&M::fx, &M::cx, &M::cy, &M::k1, &M::k2};
  static constexpr std::array<Member, 12> kTwoFocals{&M::fx, &M::fy, &M::cx, &M::cy, &M::k1, &M::k2,
                                                     &M::p1, &M::p2, &M::k3, &M::k4, &M::k5, &M::k6};
  switch (kind) {
    case CameraModelKind::kSimplePinhole:
      return std::span(kOneFocal).first(3);
    case CameraModelKind::kSimpleRadial:
      return std::span(kOneFocal).first(4);
    case CameraModelKind::kRadial:
      return std::span(kOneFocal).first(5);
    case CameraModelKind::kPinhole:
      return std::span(kTwoFocals).first(4);
    case CameraModelKind::kOpenCv:
      return std::span(kTwoFocals).first(8);
    case CameraModelKind::kFullOpenCv:
      return kTwoFocals;
  }
  return {};
}

bool HasOneFocal(CameraModelKind kind) {
  return kind != CameraModelKind::kPinhole && kind != CameraModelKind::kOpenCv && kind != CameraModelKind::kFullOpenCv;
}

bool Holds(CameraModelKind kind, const CameraModel& model) {
  const CameraModel kept = CameraFromParams(kind, [&] {
    std::vector<double> params;
    for (const Member m : Members(kind)) params.push_back(model.*m);
    return params;
  }());
  for (const Member m : Members(CameraModelKind::kFullOpenCv))
    if (kept.*m != model.*m) return false;
  return true;
}

}  // namespace

std::size_t CameraParamCount(CameraModelKind kind) { return Members(kind).size(); }

std::vector<double> CameraParams(const CameraModel& model) {
  std::vector<double> params;
  for (const Member m : Members(model.kind)) params.push_back(model.*m);
  return params;
}

CameraModel CameraFromParams(CameraModelKind kind, std::span<const double> params) {
  const auto members = Members(kind);
  RILIEVO_CHECK(params.size() == members.size());
  CameraModel model;
  model.kind = kind;
  for (std::size_t i = 0; i < members.size(); ++i) model.*members[i] = params[i];
  if (HasOneFocal(kind)) model.fy = model.fx;
  return model;
}

CameraModel WithSufficientKind(CameraModel model) {
  static constexpr std::array kOrder{CameraModelKind::kSimplePinhole, CameraModelKind::kPinhole,
                                     CameraModelKind::kSimpleRadial,  CameraModelKind::kRadial,
                                     CameraModelKind::kOpenCv,        CameraModelKind::kFullOpenCv};
  if (Holds(model.kind, model)) return model;
  for (const CameraModelKind kind : kOrder) {
    if (kind <= model.kind || !Holds(kind, model)) continue;
    model.kind = kind;
    break;
  }
  return model;
}

}  // namespace rilievo::io
