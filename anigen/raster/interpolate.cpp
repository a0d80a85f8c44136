#include "anigen/raster/interpolate.h"

#include <ATen/Dispatch.h>
#include <algorithm>
#include <array>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/nn/init.h"
#include "anigen/raster/rasterize.h"

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
    const torch::autograd::variable_list saved = nn::saved_once(*context, "face normals");
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

// A picture whose pixels blend three rows of a table; all pointers to contiguous arrays of type T.
template <typename T>
struct Blend {
  const T *attributes, *barycentric;
  const std::int64_t *faces, *triangle;
  std::int64_t pixels, channels;

  const std::int64_t* corners(std::int64_t pixel) const {
    return triangle[pixel] == 0 ? nullptr : faces + 3 * (triangle[pixel] - 1);
  }
  T u(std::int64_t pixel) const { return barycentric[2 * pixel]; }
  T v(std::int64_t pixel) const { return barycentric[2 * pixel + 1]; }
  const T* row(std::int64_t vertex) const { return attributes + channels * vertex; }
  std::int64_t grain() const { return 1 + 16384 / (1 + channels); }
};

template <typename T>
Blend<T> blend_of(const Tensor& attributes, const Tensor& barycentric, const Tensor& triangle, const Tensor& faces) {
  return {attributes.data_ptr<T>(),          barycentric.data_ptr<T>(), faces.data_ptr<std::int64_t>(),
          triangle.data_ptr<std::int64_t>(), triangle.numel(),          attributes.size(1)};
}

template <typename T>
void blend_forward(const Blend<T>& blend, T* out) {
  at::parallel_for(0, blend.pixels, blend.grain(), [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t pixel = begin; pixel < end; ++pixel) {
      T* to = out + blend.channels * pixel;
      const std::int64_t* corners = blend.corners(pixel);
      if (corners == nullptr) {
        std::fill_n(to, blend.channels, T(0));
        continue;
      }
      const T u = blend.u(pixel), v = blend.v(pixel), rest = T(1) - u - v;
      const T *a = blend.row(corners[0]), *b = blend.row(corners[1]), *c = blend.row(corners[2]);
      for (std::int64_t channel = 0; channel < blend.channels; ++channel)
        to[channel] = u * a[channel] + v * b[channel] + rest * c[channel];
    }
  });
}

template <typename T>
void blend_backward_barycentric(const Blend<T>& blend, const T* gradient, T* out) {
  at::parallel_for(0, blend.pixels, blend.grain(), [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t pixel = begin; pixel < end; ++pixel) {
      T du = T(0), dv = T(0);
      if (const std::int64_t* corners = blend.corners(pixel)) {
        const T *a = blend.row(corners[0]), *b = blend.row(corners[1]), *c = blend.row(corners[2]);
        const T* from = gradient + blend.channels * pixel;
        for (std::int64_t channel = 0; channel < blend.channels; ++channel) {
          du += from[channel] * (a[channel] - c[channel]);
          dv += from[channel] * (b[channel] - c[channel]);
        }
      }
      out[2 * pixel] = du;
      out[2 * pixel + 1] = dv;
    }
  });
}

// In fp64, since a vertex may collect from every pixel of the picture.
template <typename T>
void blend_backward_attributes(const Blend<T>& blend, const T* gradient, double* sums) {
  const auto corners_of = [&](std::int64_t pixel) { return blend.corners(pixel); };
  sum_by_vertex(blend.pixels, corners_of,
                [&](std::int64_t pixel, const std::int64_t* corners, const VertexShare& share) {
                  const T u = blend.u(pixel), v = blend.v(pixel);
                  const T weights[3] = {u, v, T(1) - u - v};
                  const T* from = gradient + blend.channels * pixel;
                  for (std::size_t k = 0; k < 3; ++k) {
                    if (!share.owns(corners[k])) continue;
                    double* to = sums + blend.channels * corners[k];
                    for (std::int64_t channel = 0; channel < blend.channels; ++channel)
                      to[channel] += static_cast<double>(weights[k] * from[channel]);
                  }
                });
}

class Interpolation : public torch::autograd::Function<Interpolation> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& attributes, const Tensor& barycentric,
                        const Tensor& triangle, const Tensor& faces) {
    RECORD_USER_SCOPE("rasteriser: interpolation");
    const Tensor table = attributes.contiguous(), weights = barycentric.contiguous();
    const Tensor out = torch::empty({triangle.size(0), triangle.size(1), table.size(1)}, table.options());
    AT_DISPATCH_FLOATING_TYPES(table.scalar_type(), "interpolation", [&] {
      blend_forward(blend_of<scalar_t>(table, weights, triangle, faces), out.data_ptr<scalar_t>());
    });
    context->save_for_backward({attributes, barycentric, triangle, faces});
    context->saved_data["attributes"] = attributes.requires_grad();
    context->saved_data["barycentric"] = barycentric.requires_grad();
    return out;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("rasteriser: interpolation");
    const torch::autograd::variable_list saved = nn::saved_once(*context, "interpolation");
    const bool is_double = nn::dtype_of(saved[0]) == torch::kFloat64;
    return is_double ? backward_in<double>(context, saved, gradients[0].contiguous())
                     : backward_in<float>(context, saved, gradients[0].contiguous());
  }

 private:
  template <typename T>
  static variable_list backward_in(AutogradContext* context, const variable_list& saved, const Tensor& gradient) {
    const Tensor table = saved[0].contiguous(), weights = saved[1].contiguous();
    const Blend<T> blend = blend_of<T>(table, weights, saved[2], saved[3]);
    Tensor to_attributes, to_barycentric;
    if (context->saved_data["attributes"].toBool()) {
      const Tensor sums = torch::zeros(table.sizes(), torch::kFloat64);
      blend_backward_attributes(blend, gradient.data_ptr<T>(), sums.data_ptr<double>());
      to_attributes = sums.to(nn::dtype_of(table));
    }
    if (context->saved_data["barycentric"].toBool()) {
      to_barycentric = torch::empty(weights.sizes(), weights.options());
      blend_backward_barycentric(blend, gradient.data_ptr<T>(), to_barycentric.data_ptr<T>());
    }
    return {to_attributes, to_barycentric, Tensor(), Tensor()};
  }
};

}  // namespace

Tensor face_normals(const Tensor& vertices, const Tensor& faces) {
  check_real(vertices, 2, "vertices");
  if (vertices.size(1) != 3) throw InputError("", "vertices", "must be [V, 3], is " + nn::shape_text(vertices));
  const Tensor corners = checked_faces(faces, vertices.size(0), "faces");
  return FaceNormals::apply(vertices.to(torch::kCPU), corners).to(vertices.device());
}

Tensor interpolate(const Tensor& attributes, const Fragments& fragments, const Tensor& faces) {
  check_real(attributes, 2, "attributes");
  const Tensor corners = checked_faces(faces, attributes.size(0), "faces");
  const Tensor triangle = checked_triangles(fragments.triangle, corners.size(0));
  const Tensor& barycentric = fragments.barycentric;
  check_real(barycentric, 3, "barycentric");
  if (barycentric.size(0) != triangle.size(0) || barycentric.size(1) != triangle.size(1) || barycentric.size(2) != 2)
    throw InputError("", "barycentric", nn::shape_text(barycentric) + " for triangles of " + nn::shape_text(triangle));
  const Tensor weights = barycentric.to(torch::kCPU, nn::dtype_of(attributes));
  return Interpolation::apply(attributes.to(torch::kCPU), weights, triangle, corners).to(attributes.device());
}

}  // namespace anigen::raster
