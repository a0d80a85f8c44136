#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/prepare/creatures/primitive.h"

namespace anigen::prepare {

/// Indices of the primitives that can matter in a region, ascending.
using PrimitiveList = std::vector<int>;

/// The implicit solid that primitives form: each is united with what came before it by a quadratic smooth minimum of
/// radius `blend` (a plain minimum where that is 0), or carved out of it. Negative inside.
class Field {
 public:
  explicit Field(std::vector<Primitive> primitives);

  const std::vector<Primitive>& primitives() const { return primitives_; }
  double value(const Eigen::Vector3d& x, const PrimitiveList& list) const;
  /// Finite differences over four points `step` away.
  Eigen::Vector3d gradient(const Eigen::Vector3d& x, const PrimitiveList& list, double step) const;
  /// Those of `list` that shape the field within `reach` of x: a few, where the list of a block has a dozen.
  void narrow(const Eigen::Vector3d& x, const PrimitiveList& list, double reach, PrimitiveList& result) const;

  enum class Content { kOutside, kInside, kMixed };
  /// What a ball holds; for kMixed `list` receives those of `candidates` that shape the field there.
  /// @param candidates all primitives, or the list of a larger ball around this one
  Content classify(const Eigen::Vector3d& center, double radius, const PrimitiveList& candidates,
                   PrimitiveList& list) const;

 private:
  std::vector<Primitive> primitives_;
};

}  // namespace anigen::prepare
