// What the payload formats share: their kinds and versions, vectors and poses, and the check of damage.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>

#include "base/error.h"
#include "base/serialize.h"
#include "geometry/rigid3.h"

namespace rilievo::io {

/// Four letters at the start of a payload.
enum class PayloadKind : std::uint32_t {
  kFeatures = 0x54414652,  // RFAT
  kPairs = 0x52415052,     // RPAR
  kMapping = 0x50414d52,   // RMAP
};

inline Error Damaged(const std::string& what) {
  return {ErrorCode::kInvalidInput, "", "damaged data: " + what, "remove it; it is computed again"};
}

inline void Require(bool condition, const char* what) {
  if (!condition) throw Damaged(what);
}

inline void PutHeader(ByteWriter& out, PayloadKind kind, std::uint32_t version) {
  out.Put(static_cast<std::uint32_t>(kind));
  out.Put(version);
}

/// Reads a whole payload by `read(reader)`; checks kind, version and that nothing is left.
template <class Read>
auto ReadPayload(std::span<const std::byte> bytes, PayloadKind kind, std::uint32_t version, Read read) {
  try {
    ByteReader in(bytes);
    if (in.Get<std::uint32_t>() != static_cast<std::uint32_t>(kind)) throw Damaged("not of the kind that belongs here");
    if (const auto found = in.Get<std::uint32_t>(); found != version)
      throw Error(ErrorCode::kVersion, "",
                  "data format version " + std::to_string(found) + ", this program reads " + std::to_string(version),
                  "use the program version that wrote it, or remove it: it is computed again");
    auto value = read(in);
    Require(in.AtEnd(), "bytes after its end");
    return value;
  } catch (const Error& error) {
    if (!error.hint().empty()) throw;
    throw Damaged(error.message());
  }
}

template <int Rows, int Cols>
void PutMatrix(ByteWriter& out, const Eigen::Matrix<double, Rows, Cols>& matrix) {
  for (int i = 0; i < Rows * Cols; ++i) out.Put(matrix.data()[i]);
}

template <int Rows, int Cols = 1>
Eigen::Matrix<double, Rows, Cols> GetMatrix(ByteReader& in) {
  Eigen::Matrix<double, Rows, Cols> matrix;
  for (int i = 0; i < Rows * Cols; ++i) matrix.data()[i] = in.Get<double>();
  return matrix;
}

inline void PutPose(ByteWriter& out, const Rigid3& pose) {
  PutMatrix<4, 1>(out, pose.rotation.coeffs());
  PutMatrix<3, 1>(out, pose.translation);
}

/// Not by Rigid3's constructor: it normalises, which may change the last bit.
inline Rigid3 GetPose(ByteReader& in) {
  Rigid3 pose;
  pose.rotation.coeffs() = GetMatrix<4>(in);
  pose.translation = GetMatrix<3>(in);
  return pose;
}

/// A count of things that take at least `least_bytes` each: bounded by what is left, so that damage cannot ask for
/// memory.
inline std::size_t GetCount(ByteReader& in, std::size_t least_bytes) {
  const auto count = in.Get<std::uint64_t>();
  Require(count <= in.Remaining() / least_bytes, "impossible count");
  return static_cast<std::size_t>(count);
}

}  // namespace rilievo::io
