// Synthetic images for the tests of detectors: sums of Gaussian blobs at known places, turned, brightened, deepened.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "base/rng.h"
#include "block/pixels.h"

namespace rilievo::testing_support {

struct Blob {
  double x_px, y_px, sigma_px, height;
};

/// Blobs on mid grey, sampled at pixel centres (first centre (0.5, 0.5)).
inline GreyImage RenderBlobs(int width_px, int height_px, const std::vector<Blob>& blobs) {
  std::vector<double> grey(static_cast<std::size_t>(width_px * height_px), 110.0);
  for (const Blob& blob : blobs) {
    const int reach = static_cast<int>(std::ceil(5 * blob.sigma_px));
    const int cx = static_cast<int>(blob.x_px), cy = static_cast<int>(blob.y_px);
    for (int y = std::max(0, cy - reach); y <= std::min(height_px - 1, cy + reach); ++y) {
      for (int x = std::max(0, cx - reach); x <= std::min(width_px - 1, cx + reach); ++x) {
        const double r_sq = std::pow(x + 0.5 - blob.x_px, 2) + std::pow(y + 0.5 - blob.y_px, 2);
        grey[static_cast<std::size_t>(y * width_px + x)] +=
            blob.height * std::exp(-r_sq / (2 * blob.sigma_px * blob.sigma_px));
      }
    }
  }
  GreyImage image;
  image.width_px = width_px;
  image.height_px = height_px;
  for (const double g : grey) image.u8.push_back(static_cast<std::uint8_t>(std::clamp(std::round(g), 0.0, 255.0)));
  return image;
}

/// Blobs of sigma 1 to 6 px all over, `zoom` times as large when rendered.
inline GreyImage BlobTexture(int width_px, int height_px, std::uint64_t seed, double zoom = 1) {
  Rng rng(seed);
  std::vector<Blob> blobs;
  for (int i = 0; i < width_px * height_px / 60; ++i) {
    Blob blob{rng.Uniform(0, width_px), rng.Uniform(0, height_px), std::exp(rng.Uniform(0.0, 1.8)),
              rng.Uniform(-60, 60)};
    blobs.push_back({zoom * blob.x_px, zoom * blob.y_px, zoom * blob.sigma_px, blob.height});
  }
  return RenderBlobs(static_cast<int>(zoom * width_px), static_cast<int>(zoom * height_px), blobs);
}

/// A quarter turn: pixel (x, y) comes to (height - 1 - y, x), so that +x becomes +y.
inline GreyImage QuarterTurn(const GreyImage& image) {
  GreyImage turned;
  turned.width_px = image.height_px;
  turned.height_px = image.width_px;
  turned.u8.resize(image.u8.size());
  for (int y = 0; y < image.height_px; ++y) {
    for (int x = 0; x < image.width_px; ++x) {
      turned.u8[static_cast<std::size_t>(x * turned.width_px + image.height_px - 1 - y)] =
          image.u8[static_cast<std::size_t>(y * image.width_px + x)];
    }
  }
  return turned;
}

/// The same image with 16 bits a pixel, values times `gain`.
inline GreyImage Deepen(const GreyImage& image, int gain) {
  GreyImage deep;
  deep.width_px = image.width_px;
  deep.height_px = image.height_px;
  for (const int v : image.u8) deep.u16.push_back(static_cast<std::uint16_t>(v * gain));
  return deep;
}

/// An 8-bit image under the binomial 1 4 6 4 1 along both axes, half-sample reflection, rounded to 1/16 of a level.
inline GreyImage SmoothSixteenfold(const GreyImage& image) {
  const int weights[5] = {1, 4, 6, 4, 1};
  const auto reflect = [](int i, int n) {
    while (i < 0 || i >= n) i = i < 0 ? -1 - i : 2 * n - 1 - i;
    return i;
  };
  GreyImage smooth;
  smooth.width_px = image.width_px;
  smooth.height_px = image.height_px;
  for (int i = 0; i < image.width_px * image.height_px; ++i) {
    int sum = 8;
    for (int k = 0; k < 25; ++k) {
      const int x = reflect(i % image.width_px + k % 5 - 2, image.width_px);
      const int y = reflect(i / image.width_px + k / 5 - 2, image.height_px);
      sum += weights[k % 5] * weights[k / 5] * image.u8[static_cast<std::size_t>(y * image.width_px + x)];
    }
    smooth.u16.push_back(static_cast<std::uint16_t>(sum / 16));
  }
  return smooth;
}

}  // namespace rilievo::testing_support
