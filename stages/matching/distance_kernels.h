// Squared distances of one descriptor from chosen ones of a list: the kernels, one a file, and the choice among them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

namespace rilievo::matching {

/// out[i] = |query - points[indices[i]]|^2 for i < count. `points` are descriptors of 128 bytes, one after the other;
/// any byte values, at most 128 * 255^2 = 8,323,200. All kernels give the same integers.
using DistanceKernel = void (*)(const std::uint8_t* query, const std::uint8_t* points, const std::uint32_t* indices,
                                std::size_t count, std::int32_t* out);

void DistancesScalar(const std::uint8_t* query, const std::uint8_t* points, const std::uint32_t* indices,
                     std::size_t count, std::int32_t* out);
void DistancesAvx2(const std::uint8_t* query, const std::uint8_t* points, const std::uint32_t* indices,
                   std::size_t count, std::int32_t* out);
void DistancesAvx512(const std::uint8_t* query, const std::uint8_t* points, const std::uint32_t* indices,
                     std::size_t count, std::int32_t* out);

/// The kernel that goes with the sweep of that name (matching_kernels.h): scalar, avx2 or avx512. Whether the processor
/// supports it was decided with the sweep. A caller's bug for another name.
DistanceKernel DistanceKernelOf(std::string_view name);

}  // namespace rilievo::matching
