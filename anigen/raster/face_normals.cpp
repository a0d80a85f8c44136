#include "anigen/raster/face_normals.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/nn/shape_text.h"
#include "anigen/raster/check_inputs.h"
#include "anigen/raster/vertex_sums.h"

namespace anigen::raster {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;
using Vector3 = std::array<double, 3>;

constexpr double kLeastDoubledArea = 1e-12;
constexpr std::int64_t kGrainFaces = 2048;

Vector3 cross_product(const Vector3& a, const Vector3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

double dot_product(const Vector3& a, const Vector3& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// The two sides from the first corner, and the normal with its length before it is made a unit vector.
struct FaceFrame {
  FaceFrame(const double* vertices, const std::int64_t* corners) {
    const double *a = vertices + 3 * corners[0], *b = vertices + 3 * corners[1], *c = vertices + 3 * corners[2];
    for (std::size_t k = 0; k < 3; ++k) {
      to_second[k] = b[k] - a[k];
      to_third[k] = c[k] - a[k];
    }
    normal = cross_product(to_second, to_third);
    length = std::sqrt(dot_product(normal, normal));
    for (double& value : normal) value /= std::max(length, kLeastDoubledArea);
  }

  /// Gradients of the second and third corner; the first one's is minus their sum.
  std::array<Vector3, 2> gradients(const Vector3& by_normal) const {
    const double radial = dot_product(normal, by_normal);
    Vector3 by_cross;
    for (std::size_t k = 0; k < 3; ++k) by_cross[k] = (by_normal[k] - radial * normal[k]) / length;
    return {cross_product(to_third, by_cross), cross_product(by_cross, to_second)};
  }

  Vector3 to_second{}, to_third{}, normal{};
  double length = 0.0;
};

class FaceNormals : public torch::autograd::Function<FaceNormals> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& vertices, const Tensor& faces) {
    RECORD_USER_SCOPE("rasteriser: face normals");
    const Tensor positions = vertices.to(torch::kFloat64).contiguous();
    const Tensor normals = torch::empty({faces.size(0), 3}, torch::kFloat64);
    const double* points = positions.data_ptr<double>();
    const std::int64_t* corners = faces.data_ptr<std::int64_t>();
    double* out = normals.data_ptr<double>();
    at::parallel_for(0, faces.size(0), kGrainFaces, [&](std::int64_t begin, std::int64_t end) {
      for (std::int64_t face = begin; face < end; ++face) {
        const FaceFrame frame(points, corners + 3 * face);
        std::copy(frame.normal.begin(), frame.normal.end(), out + 3 * face);
      }
    });
    context->save_for_backward({vertices, faces});
    return normals.to(nn::dtype_of(vertices));
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("rasteriser: face normals");
    TORCH_CHECK(!at::GradMode::is_enabled(), "face normals can be differentiated once only");
    const variable_list saved = context->get_saved_variables();
    const Tensor &vertices = saved[0], &faces = saved[1];
    const Tensor positions = vertices.to(torch::kFloat64).contiguous();
    const Tensor slopes = gradients[0].to(torch::kFloat64).contiguous(), sums = torch::zeros_like(positions);
    const double *points = positions.data_ptr<double>(), *slope = slopes.data_ptr<double>();
    const std::int64_t* corners = faces.data_ptr<std::int64_t>();
    double* sum = sums.data_ptr<double>();
    const auto corners_of = [&](std::int64_t face) -> const std::int64_t* {
      const double* s = slope + 3 * face;  // zero for all that is not visible
      return s[0] == 0.0 && s[1] == 0.0 && s[2] == 0.0 ? nullptr : corners + 3 * face;
    };
    const auto add = [&](std::int64_t face, const std::int64_t* vertex, const VertexShare& share) {
      const FaceFrame frame(points, vertex);
      if (!(frame.length > kLeastDoubledArea)) return;
      const double* s = slope + 3 * face;
      const auto moved = frame.gradients({s[0], s[1], s[2]});
      for (std::size_t k = 0; k < 3; ++k) {
        if (share.owns(vertex[0])) sum[3 * vertex[0] + static_cast<std::int64_t>(k)] -= moved[0][k] + moved[1][k];
        if (share.owns(vertex[1])) sum[3 * vertex[1] + static_cast<std::int64_t>(k)] += moved[0][k];
        if (share.owns(vertex[2])) sum[3 * vertex[2] + static_cast<std::int64_t>(k)] += moved[1][k];
      }
    };
    sum_by_vertex(faces.size(0), corners_of, add);
    return {sums.to(nn::dtype_of(vertices)), Tensor()};
  }
};

}  // namespace

Tensor face_normals(const Tensor& vertices, const Tensor& faces) {
  check_real(vertices, 2, "vertices");
  if (vertices.size(1) != 3) throw InputError("", "vertices", "must be [V, 3], is " + nn::shape_text(vertices));
  const Tensor corners = checked_faces(faces, vertices.size(0), "faces");
  return FaceNormals::apply(vertices.to(torch::kCPU), corners).to(vertices.device());
}

}  // namespace anigen::raster
