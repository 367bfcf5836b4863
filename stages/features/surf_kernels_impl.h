// The kernels of SURF written once, over the lanes of a processor level (base/lanes_*.h). Lanes never mix but in exact
// integer sums, so that all levels give the same bits. Included by surf_kernels_{scalar,avx2,avx512}.cc only.
#pragma once

#include <bit>

#include "stages/features/surf_geometry.h"
#include "stages/features/surf_kernels.h"

namespace rilievo::features {

template <class L>
void Integrate(const std::uint16_t* line, int count, int shift, const std::int32_t* above, std::int32_t* below) {
  using I = typename L::I;
  const I half = L::Set(std::int32_t{1} << (shift - 1));
  below[0] = above[0];
  I carry = L::Set(std::int32_t{0});
  for (int i = 0; i < count; i += L::kWidth) {
    const auto at = [&](int k) { return L::LoadU16I(line + i + k); };
    const auto twice = [](I v) { return L::WrapAdd(v, v); };
    // 1 4 6 4 1 = outer + 4 inner + 6 middle = outer + 2 (2 (inner + middle) + middle)
    const I inner = L::WrapAdd(L::WrapAdd(at(1), at(3)), at(2));
    const I sum = L::WrapAdd(L::WrapAdd(at(0), at(4)), twice(L::WrapAdd(twice(inner), at(2))));
    const I row = L::WrapAdd(L::PrefixSum(L::ShiftRight(L::WrapAdd(sum, half), shift)), carry);
    carry = L::LastLane(row);
    L::StoreI(below + i + 1, L::WrapAdd(L::LoadI(above + i + 1), row));
  }
}

/// Differences of rows first (they are shared by all columns), differences of columns then.
template <class L>
void Hessian(const surf::HessianRow& row) {
  using F = typename L::F;
  using I = typename L::I;
  constexpr int kBlock = 512, kWidest = kBlock + surf::kFilter[surf::kFilters - 1].size_px + 1 + 2 * L::kWidth;
  std::int32_t xx[kWidest], yy[kWidest], xy[kWidest];
  const int l = row.lobe, reach = (3 * l - 1) / 2;
  const F scale = L::Set(row.inverse_area), scale_xy = L::Set(0.9F * row.inverse_area);
  const auto load = [](const std::int32_t* p) { return L::LoadI(p); };
  const auto thrice = [](I v) { return L::WrapAdd(v, L::WrapAdd(v, v)); };
  for (int begin = 0; begin < row.count; begin += kBlock) {
    const int count = row.count - begin < kBlock ? row.count - begin : kBlock, columns = count + 3 * l;
    // Pointers of their own: a vector store could change those in `row` for all that the compiler knows.
    const auto at = [&](int r) { return row.rows[r] + begin - reach; };
    {
      const std::int32_t *p0 = at(0), *p1 = at(1), *p2 = at(2), *p3 = at(3), *p4 = at(4), *p5 = at(5);
      for (int i = 0; i < columns; i += L::kWidth) {
        L::StoreI(xx + i, L::WrapSub(load(p1 + i), load(p0 + i)));
        const I whole = L::WrapSub(load(p5 + i), load(p2 + i));
        L::StoreI(yy + i, L::WrapSub(whole, thrice(L::WrapSub(load(p4 + i), load(p3 + i)))));
      }
    }
    {
      const std::int32_t *p6 = at(6), *p7 = at(7), *p8 = at(8), *p9 = at(9);
      for (int i = 0; i < columns; i += L::kWidth) {
        L::StoreI(xy + i, L::WrapSub(L::WrapSub(load(p9 + i), load(p8 + i)), L::WrapSub(load(p7 + i), load(p6 + i))));
      }
    }
    // Each line from the column that comes first for pixel 0: -reach, -(l - 1), -l.
    const std::int32_t *line_xx = xx, *line_yy = yy + (reach - l + 1), *line_xy = xy + (reach - l);
    float* out = row.out + begin;
    for (int i = 0; i < count; i += L::kWidth) {
      const I whole = L::WrapSub(load(line_xx + i + 3 * l), load(line_xx + i));
      const I middle = L::WrapSub(load(line_xx + i + 2 * l), load(line_xx + i + l));
      const F d_xx = scale * L::ToFloat(L::WrapSub(whole, thrice(middle)));
      const F d_yy = scale * L::ToFloat(L::WrapSub(load(line_yy + i + (2 * l - 1)), load(line_yy + i)));
      const I right = L::WrapSub(load(line_xy + i + (2 * l + 1)), load(line_xy + i + (l + 1)));
      const F d_xy = scale_xy * L::ToFloat(L::WrapSub(right, L::WrapSub(load(line_xy + i + l), load(line_xy + i))));
      L::Store(out + i, L::Fma(d_xx, d_yy, L::Set(0.0F) - d_xy * d_xy));
    }
  }
}

template <class L>
int Extrema(const surf::ExtremaRow& row, std::int32_t* columns) {
  using F = typename L::F;
  const F threshold = L::Set(row.threshold);
  const auto largest3 = [](const float* p) { return L::Max(L::Max(L::Load(p - 1), L::Load(p)), L::Load(p + 1)); };
  int found = 0;
  for (int x = 0; x < row.count; x += L::kWidth) {
    const F value = L::Load(row.layers[1][1] + x);
    std::uint32_t bits = L::Bits(L::Less(threshold, value));
    if (bits == 0) continue;
    const F before = L::Max(largest3(row.layers[1][0] + x), L::Load(row.layers[1][1] + x - 1));
    const F after = L::Max(largest3(row.layers[1][2] + x), L::Load(row.layers[1][1] + x + 1));
    bits &= L::Bits(L::Less(before, value)) & ~L::Bits(L::Less(value, after));
    if (bits == 0) continue;
    const F lower =
        L::Max(L::Max(largest3(row.layers[0][0] + x), largest3(row.layers[0][1] + x)), largest3(row.layers[0][2] + x));
    const F upper =
        L::Max(L::Max(largest3(row.layers[2][0] + x), largest3(row.layers[2][1] + x)), largest3(row.layers[2][2] + x));
    bits &= L::Bits(L::Less(lower, value)) & ~L::Bits(L::Less(value, upper));
    if (row.count - x < L::kWidth) bits &= (1U << (row.count - x)) - 1;
    for (; bits != 0; bits &= bits - 1) columns[found++] = x + std::countr_zero(bits);
  }
  return found;
}

/// Responses of Haar wavelets of half width `half` whose centres are rounded to the nearest pixel corner.
template <class L>
struct HaarProbe {
  using F = typename L::F;
  using I = typename L::I;
  const surf::IntegralView& view;
  I half, mask, stride, origin;

  HaarProbe(const surf::IntegralView& v, float half_px)
      : view(v),
        half(L::Round(L::Set(half_px))),
        mask(L::Set(v.row_mask)),
        stride(L::Set(v.stride)),
        origin(L::Set(v.origin_x)) {}

  struct Response {
    F x, y;
  };
  Response At(F x_px, F y_px) const {
    const I x = L::WrapSub(L::Round(x_px), origin), y = L::Round(y_px);
    const I left = L::WrapSub(x, half), right = L::WrapAdd(x, half);
    const auto row = [&](I at) { return L::Mul(L::And(at, mask), stride); };
    const I top = row(L::WrapSub(y, half)), middle = row(y), bottom = row(L::WrapAdd(y, half));
    const auto sum = [&](I r, I c) { return L::Gather(view.data, L::WrapAdd(r, c)); };
    const I a = sum(top, left), c = sum(top, right), g = sum(bottom, left), i = sum(bottom, right);
    const I b = sum(top, x), h = sum(bottom, x), d = sum(middle, left), f = sum(middle, right);
    const I whole_up = L::WrapSub(i, c), whole_left = L::WrapSub(i, g);
    // right - left = (i - c - h + b) - (h - b - g + a);  bottom - top = (i - g - f + d) - (f - d - c + a)
    const I column = L::WrapSub(h, b), line = L::WrapSub(f, d);
    const I dx = L::WrapSub(L::WrapSub(whole_up, column), L::WrapSub(column, L::WrapSub(g, a)));
    const I dy = L::WrapSub(L::WrapSub(whole_left, line), L::WrapSub(line, L::WrapSub(c, a)));
    return {L::ToFloat(dx), L::ToFloat(dy)};
  }
};

/// Direction of (x, y) in bins of 5 degrees. In the first quadrant 9 + t p(t^2) with t = (|y| - |x|) / (|y| + |x|) and
/// p(t^2) ~ atan(t) 36 / (pi t), off by less than 0.003 bins; the coefficients are multiples of 2^-12 whose sum is 9,
/// so that axes and diagonals come out exact.
template <class L>
typename L::I BinOf(typename L::F x, typename L::F y) {
  using F = typename L::F;
  const F zero = L::Set(0.0F), ax = L::Abs(x), ay = L::Abs(y);
  const F t = (ay - ax) / L::Max(ay + ax, L::Set(1.0e-30F)), u = t * t;
  F p = L::Fma(L::Set(surf::kAtan[4]), u, L::Set(surf::kAtan[3]));
  p = L::Fma(p, u, L::Set(surf::kAtan[2]));
  p = L::Fma(p, u, L::Set(surf::kAtan[1]));
  p = L::Fma(p, u, L::Set(surf::kAtan[0]));
  F turn = L::Fma(t, p, L::Set(9.0F));
  turn = L::Select(L::Less(x, zero), L::Set(36.0F) - turn, turn);
  turn = L::Select(L::Less(y, zero), L::Set(72.0F) - turn, turn);
  return L::Truncate(L::Min(turn, L::Set(71.0F)));
}

template <class L>
void Circle(const surf::Window& window, const surf::Tables& tables, surf::CircleResponses* out) {
  using F = typename L::F;
  const HaarProbe<L> probe(window.integral, 2 * window.scale_px);
  const F s = L::Set(window.scale_px), x0 = L::Set(window.x_px), y0 = L::Set(window.y_px);
  for (int i = 0; i < surf::kCircleSamples; i += L::kWidth) {
    const auto response =
        probe.At(L::Fma(s, L::Load(tables.circle_u + i), x0), L::Fma(s, L::Load(tables.circle_v + i), y0));
    const F weight = L::Load(tables.circle_weight + i);
    L::Store(out->x + i, weight * response.x);
    L::Store(out->y + i, weight * response.y);
    L::StoreI(out->bin + i, BinOf<L>(response.x, response.y));
  }
}

template <class L>
void Describe(const surf::Window& window, const surf::Tables& tables, float (*sums)[surf::kCells]) {
  using F = typename L::F;
  const HaarProbe<L> probe(window.integral, window.scale_px);
  const F x0 = L::Set(window.x_px), y0 = L::Set(window.y_px), zero = L::Set(0.0F);
  const F cosine = L::Set(window.cosine), sine = L::Set(window.sine);
  const F s_cosine = L::Set(window.scale_px * window.cosine), s_sine = L::Set(window.scale_px * window.sine);
  for (int cell = 0; cell < surf::kCells; cell += L::kWidth) {
    F sum[surf::kComponents];
#pragma GCC unroll 8
    for (int k = 0; k < surf::kComponents; ++k) sum[k] = zero;
    for (int i = 0; i < surf::kCellSamples; ++i) {
      const F u = L::Load(&tables.grid_u[i][cell]), v = L::Load(&tables.grid_v[i][cell]);
      const auto response = probe.At(L::Fma(s_cosine, u, x0) - s_sine * v, L::Fma(s_sine, u, y0) + s_cosine * v);
      const F weight = L::Load(&tables.grid_weight[i][cell]), wx = weight * response.x, wy = weight * response.y;
      const F dx = L::Fma(cosine, wx, sine * wy), dy = L::Fma(cosine, wy, zero - sine * wx);
      const auto is_up = L::Less(dy, zero), is_left = L::Less(dx, zero);
      const F abs_dx = L::Abs(dx), abs_dy = L::Abs(dy);
      sum[0] = sum[0] + L::Select(is_up, dx, zero);
      sum[1] = sum[1] + L::Select(is_up, abs_dx, zero);
      sum[2] = sum[2] + L::Select(is_up, zero, dx);
      sum[3] = sum[3] + L::Select(is_up, zero, abs_dx);
      sum[4] = sum[4] + L::Select(is_left, dy, zero);
      sum[5] = sum[5] + L::Select(is_left, abs_dy, zero);
      sum[6] = sum[6] + L::Select(is_left, zero, dy);
      sum[7] = sum[7] + L::Select(is_left, zero, abs_dy);
    }
#pragma GCC unroll 8
    for (int k = 0; k < surf::kComponents; ++k) L::Store(sums[k] + cell, sum[k]);
  }
}

template <class L>
constexpr SurfKernels MakeSurfKernels(const char* name) {
  SurfKernels kernels;
  kernels.name = name;
  kernels.integrate = Integrate<L>;
  kernels.hessian = Hessian<L>;
  kernels.extrema = Extrema<L>;
  kernels.circle = Circle<L>;
  kernels.describe = Describe<L>;
  return kernels;
}

}  // namespace rilievo::features
