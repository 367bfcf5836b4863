// Features, pairs and models as bytes: the payloads of artifacts.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "block/features.h"
#include "block/model.h"
#include "block/pair.h"

namespace rilievo::io {

/// What mapping gives: oriented components and the images in none.
struct MappingResult {
  std::vector<Model> models;
  std::vector<UnorientedImage> unoriented;
};

/// Each begins with a kind and a version number; equal values give equal bytes, and reading gives the value back to the
/// bit. Cost: one copy of the data.
std::vector<std::byte> Serialize(const ImageFeatures& features);
std::vector<std::byte> Serialize(std::span<const TwoViewGeometry> pairs);
std::vector<std::byte> Serialize(const MappingResult& result);

/// Throw Error(kVersion) for data of another kind or version and Error(kInvalidInput) for damaged data (cut off, too
/// long, ids or counts that contradict each other): nothing outside the bytes is ever read.
ImageFeatures DeserializeFeatures(std::span<const std::byte> bytes);
std::vector<TwoViewGeometry> DeserializePairs(std::span<const std::byte> bytes);
MappingResult DeserializeMapping(std::span<const std::byte> bytes);

}  // namespace rilievo::io
