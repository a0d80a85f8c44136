#include "anigen/io/rigs/axes.h"

#include "anigen/core/error.h"

namespace anigen::io {
namespace {

/// (x, y, z) → (x, -sign · z, sign · y): a quarter turn about x.
template <typename Vector>
void turn(std::vector<Vector>& vectors, int sign) {
  for (Vector& v : vectors) v = Vector(v.x(), -sign * v.z(), sign * v.y());
}

void turn(RiggedShape& shape, int sign) {
  turn(shape.mesh.vertices, sign);
  turn(shape.mesh.normals, sign);
  turn(shape.joints.positions, sign);
  Eigen::Matrix3d quarter;
  quarter << 1, 0, 0, 0, 0, -sign, 0, sign, 0;
  shape.clips_turn = quarter * shape.clips_turn;
}

}  // namespace

Axes parse_axes(const std::string& word) {
  for (const Axes axes : {Axes::kFormat, Axes::kYUp, Axes::kZUp}) {
    if (word == name_of(axes)) return axes;
  }
  throw InputError("", "axes", "\"" + word + "\" is none of format, y-up, z-up");
}

const char* name_of(Axes axes) {
  switch (axes) {
    case Axes::kYUp:
      return "y-up";
    case Axes::kZUp:
      return "z-up";
    case Axes::kFormat:
      break;
  }
  return "format";
}

void from_y_up(RiggedShape& shape) { turn(shape, 1); }
void to_y_up(RiggedShape& shape) { turn(shape, -1); }

void turn_to_z_up(RiggedShape& shape, Axes wanted, Axes format) {
  if ((wanted == Axes::kFormat ? format : wanted) == Axes::kYUp) from_y_up(shape);
}

}  // namespace anigen::io
