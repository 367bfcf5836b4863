// Puts decoded pixels into a grey image.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

#include "block/pixels.h"
#include "stages/images/luma.h"

namespace rilievo::images {

/// An image of this size, ready for StorePixels.
template <class T>
GreyImage EmptyImage(int width_px, int height_px, bool with_color) {
  GreyImage image;
  image.width_px = width_px;
  image.height_px = height_px;
  const auto pixels = static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px);
  if constexpr (std::is_same_v<T, std::uint8_t>)
    image.u8.resize(pixels);
  else
    image.u16.resize(pixels);
  if (with_color) image.rgb.resize(3 * pixels);
  return image;
}

/// Where decoded pixels go: `count` of them from (x, y) on, `step` apart.
struct PixelRun {
  int x = 0, y = 0, count = 0, step = 1;
};

/// Stores the pixels at `samples`, of `channels` interleaved samples each: the first three are R, G, B when `is_color`,
/// else the first is grey. Colours are stored where the image has room for them.
template <class T>
void StorePixels(const T* samples, int channels, bool is_color, const PixelRun& run, GreyImage& image) {
  const auto to_byte = [](unsigned v) {
    return static_cast<std::uint8_t>(sizeof(T) == 1 ? v : (v * 255U + 32767U) / 65535U);
  };
  T* grey;
  if constexpr (std::is_same_v<T, std::uint8_t>)
    grey = image.u8.data();
  else
    grey = image.u16.data();
  const bool with_color = !image.rgb.empty();
  std::size_t at =
      static_cast<std::size_t>(run.y) * static_cast<std::size_t>(image.width_px) + static_cast<std::size_t>(run.x);
  for (int i = 0; i < run.count; ++i, samples += channels, at += static_cast<std::size_t>(run.step)) {
    const unsigned r = samples[0], g = is_color ? samples[1] : r, b = is_color ? samples[2] : r;
    grey[at] = is_color ? Luma<T>(r, g, b) : samples[0];
    if (!with_color) continue;
    image.rgb[3 * at] = to_byte(r);
    image.rgb[3 * at + 1] = to_byte(g);
    image.rgb[3 * at + 2] = to_byte(b);
  }
}

}  // namespace rilievo::images
