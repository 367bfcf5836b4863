// The state as bytes.
#include "stages/mapping/mapper_state.h"

#include <algorithm>

#include "block/io/serialize_block.h"
#include "block/io/serialize_common.h"

namespace rilievo::mapping {
namespace {

constexpr std::uint32_t kLayout = 1;

template <class T>
void PutOptional(ByteWriter& out, const std::optional<T>& value, void (*put)(ByteWriter&, const T&)) {
  out.Put<std::uint8_t>(value.has_value());
  if (value) put(out, *value);
}

void PutReconstruction(ByteWriter& out, const Reconstruction& model) { model.Write(out); }

void PutGrowth(ByteWriter& out, const GrowthState& state) {
  state.model.Write(out);
  out.Put(state.phase);
  out.PutVector(state.failed_at);
  out.Put(state.images_then);
  out.Put(state.points_then);
  out.Put(state.added);
}

void PutFinish(ByteWriter& out, const FinishState& state) {
  state.model.Write(out);
  out.Put(state.step);
}

GrowthState GetGrowth(ByteReader& in, const TieBlock& ties, std::uint64_t seed) {
  GrowthState state{Reconstruction::Read(in, ties, seed), in.Get<std::uint32_t>(), in.GetVector<std::uint32_t>()};
  io::Require(state.failed_at.empty() || state.failed_at.size() == ties.NumImages(), "another number of images");
  state.images_then = in.Get<std::uint64_t>();
  state.points_then = in.Get<std::uint64_t>();
  state.added = in.Get<std::uint32_t>();
  return state;
}

}  // namespace

std::size_t MapperState::NumMapped() const {
  std::size_t mapped = 0;
  for (const Model& model : models) mapped += model.cam_from_world.size();
  if (finishing) return mapped + finishing->model.NumRegistered();
  return mapped + std::max(growing ? growing->model.NumRegistered() : 0, best ? best->NumRegistered() : 0);
}

namespace {

/// Not inlined: on a vector that it knows to be empty GCC 12 sees overflows that are none.
[[gnu::noinline]] void Put(ByteWriter& out, const MapperState& state) {
  out.Put(kLayout);
  out.PutVector(state.available);
  out.PutVector(io::Serialize(io::MappingResult{state.models, {}}));
  out.Put(state.next_seed);
  out.Put(state.starts);
  out.Put(state.growths);
  PutOptional(out, state.growing, PutGrowth);
  PutOptional(out, state.best, PutReconstruction);
  PutOptional(out, state.finishing, PutFinish);
}

}  // namespace

std::vector<std::byte> Serialize(const MapperState& state) {
  ByteWriter out;
  Put(out, state);
  return out.Take();
}

MapperState DeserializeState(std::span<const std::byte> bytes, const TieBlock& ties, std::uint64_t seed) {
  ByteReader in(bytes);
  io::Require(in.Get<std::uint32_t>() == kLayout, "another layout");
  MapperState state;
  state.available = in.GetVector<std::uint8_t>();
  io::Require(state.available.size() == ties.NumImages(), "another number of images");
  state.models = io::DeserializeMapping(in.GetVector<std::byte>()).models;
  state.next_seed = in.Get<std::uint32_t>();
  state.starts = in.Get<std::uint32_t>();
  state.growths = in.Get<std::uint32_t>();
  if (in.Get<std::uint8_t>() != 0) state.growing = GetGrowth(in, ties, seed);
  if (in.Get<std::uint8_t>() != 0) state.best = Reconstruction::Read(in, ties, seed);
  if (in.Get<std::uint8_t>() != 0)
    state.finishing = FinishState{Reconstruction::Read(in, ties, seed), in.Get<std::uint32_t>()};
  io::Require(in.AtEnd(), "bytes after its end");
  return state;
}

}  // namespace rilievo::mapping
