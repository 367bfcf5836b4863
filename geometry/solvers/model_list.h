// The few solutions of a minimal problem, without heap.
#pragma once

#include <array>
#include <cstddef>

#include "base/check.h"

namespace rilievo {

/// Up to kCapacity models, in the order they were added.
template <class Model, int kCapacity>
class ModelList {
 public:
  void Add(const Model& model) {
    RILIEVO_CHECK(size_ < kCapacity);
    models_[static_cast<std::size_t>(size_++)] = model;
  }
  int size() const { return size_; }
  const Model& operator[](int i) const { return models_[static_cast<std::size_t>(i)]; }
  const Model* begin() const { return models_.data(); }
  const Model* end() const { return models_.data() + size_; }

 private:
  std::array<Model, static_cast<std::size_t>(kCapacity)> models_;
  int size_ = 0;
};

}  // namespace rilievo
