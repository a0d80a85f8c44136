#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <ostream>
#include <string>
#include <vector>

#include "anigen/shape_field/cube_field.h"

namespace anigen::shape_field::test {

using Place = std::array<double, 3>;
/// Signed distance, or a function that behaves like one near its zero set; negative inside.
using Implicit = std::function<double(const Place&)>;

struct ImplicitShape {
  std::string name;
  Implicit distance;
};
inline std::ostream& operator<<(std::ostream& out, const ImplicitShape& shape) { return out << shape.name; }

inline double length_of(double a, double b, double c = 0.0) { return std::sqrt(a * a + b * b + c * c); }

inline Implicit sphere_at(double radius, const Place& c = {}) {
  return [=](const Place& p) { return length_of(p[0] - c[0], p[1] - c[1], p[2] - c[2]) - radius; };
}

inline Implicit box_at(const Place& half, const Place& c, double rounding = 0.0) {
  return [=](const Place& p) {
    Place q{};
    for (std::size_t i = 0; i < 3; ++i) q[i] = std::abs(p[i] - c[i]) - half[i] + rounding;
    const double outside = length_of(std::max(q[0], 0.0), std::max(q[1], 0.0), std::max(q[2], 0.0));
    return outside + std::min(std::max({q[0], q[1], q[2]}), 0.0) - rounding;
  };
}

inline Implicit torus_at(double large, double small, const Place& c, std::size_t axis) {
  return [=](const Place& p) {
    const std::size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
    return length_of(length_of(p[u] - c[u], p[v] - c[v]) - large, p[axis] - c[axis]) - small;
  };
}

inline Implicit capsule_between(const Place& a, const Place& b, double radius) {
  return [=](const Place& p) {
    double along = 0.0, square = 0.0;
    for (std::size_t i = 0; i < 3; ++i) {
      along += (p[i] - a[i]) * (b[i] - a[i]);
      square += (b[i] - a[i]) * (b[i] - a[i]);
    }
    const double t = std::clamp(along / square, 0.0, 1.0);
    Place d{};
    for (std::size_t i = 0; i < 3; ++i) d[i] = p[i] - a[i] - t * (b[i] - a[i]);
    return length_of(d[0], d[1], d[2]) - radius;
  };
}

inline Implicit cylinder_z(double radius, double half) {
  return [=](const Place& p) {
    const double d = length_of(p[0], p[1]) - radius, e = std::abs(p[2]) - half;
    return std::min(std::max(d, e), 0.0) + length_of(std::max(d, 0.0), std::max(e, 0.0));
  };
}

inline Implicit ellipsoid_at(const Place& radii) {
  return [=](const Place& p) {
    return (length_of(p[0] / radii[0], p[1] / radii[1], p[2] / radii[2]) - 1.0) *
           std::min({radii[0], radii[1], radii[2]});
  };
}

inline Implicit union_of(const std::vector<Implicit>& parts) {
  return [=](const Place& p) {
    double least = parts[0](p);
    for (const Implicit& part : parts) least = std::min(least, part(p));
    return least;
  };
}

inline Implicit common_to(const Implicit& a, const Implicit& b) {
  return [=](const Place& p) { return std::max(a(p), b(p)); };
}

inline Implicit difference_of(const Implicit& a, const Implicit& b) {
  return [=](const Place& p) { return std::max(a(p), -b(p)); };
}

inline Implicit hollow(const Implicit& a, double half_thickness) {
  return [=](const Place& p) { return std::abs(a(p)) - half_thickness; };
}

inline Implicit blend_of(const Implicit& a, const Implicit& b, double width) {
  return [=](const Place& p) {
    const double x = a(p), y = b(p), t = std::max(width - std::abs(x - y), 0.0) / width;
    return std::min(x, y) - t * t * width / 4.0;
  };
}

inline Implicit gyroid(double frequency, double half_thickness) {
  return [=](const Place& p) {
    const double x = frequency * p[0], y = frequency * p[1], z = frequency * p[2];
    const double g = std::sin(x) * std::cos(y) + std::sin(y) * std::cos(z) + std::sin(z) * std::cos(x);
    return std::abs(g) / (1.5 * frequency) - half_thickness;
  };
}

/// Shapes that fit [-0.5, 0.5]³, with sizes that keep their surfaces off the vertices of small grids.
inline std::vector<ImplicitShape> implicit_shapes() {
  const double octahedron = 0.391;
  return {
      {"sphere", sphere_at(0.4013)},
      {"small sphere", sphere_at(0.2007, {0.1031, -0.1503, 0.0507})},
      {"torus", torus_at(0.2803, 0.1009, {0.0011, 0.0017, -0.0007}, 2)},
      {"torus about x", torus_at(0.2503, 0.0807, {0.013, 0.021, -0.017}, 0)},
      {"box", box_at({0.3011, 0.2017, 0.2533}, {0.0031, 0.0017, -0.0023})},
      {"rounded box", box_at({0.3011, 0.2517, 0.2023}, {0.001, 0.002, 0.003}, 0.0811)},
      {"capsule", capsule_between({-0.25, -0.2, -0.15}, {0.22, 0.24, 0.18}, 0.1207)},
      {"cylinder", cylinder_z(0.2507, 0.3013)},
      {"ellipsoid", ellipsoid_at({0.4011, 0.2507, 0.3013})},
      {"octahedron",
       [=](const Place& p) {
         return (std::abs(p[0] - 0.003) + std::abs(p[1] + 0.002) + std::abs(p[2] - 0.001) - octahedron) /
                std::sqrt(3.0);
       }},
      {"two spheres", union_of({sphere_at(0.2011, {-0.1507, 0, 0}), sphere_at(0.2213, {0.1603, 0.05, 0.02})})},
      {"lens", common_to(sphere_at(0.3511, {-0.1507, 0, 0}), sphere_at(0.3611, {0.1603, 0.01, 0.02}))},
      {"bitten sphere", difference_of(sphere_at(0.3511), sphere_at(0.2511, {0.2503, 0.1, 0.07}))},
      {"blended spheres", blend_of(sphere_at(0.1811, {-0.1907, 0, 0}), sphere_at(0.2013, {0.1803, 0.05, 0.02}), 0.15)},
      {"three capsules", union_of({capsule_between({-0.35, 0.003, 0.001}, {0.35, 0.002, -0.003}, 0.0807),
                                   capsule_between({0.001, -0.35, 0.002}, {-0.003, 0.35, 0.001}, 0.0907),
                                   capsule_between({0.002, 0.001, -0.35}, {0.001, -0.002, 0.35}, 0.1007)})},
      {"hollow sphere", hollow(sphere_at(0.3007), 0.0713)},
      {"linked tori", union_of({torus_at(0.2003, 0.0607, {-0.1013, 0.003, 0.001}, 2),
                                torus_at(0.2011, 0.0613, {0.1007, 0.002, -0.003}, 1)})},
      {"gyroid in a sphere", common_to(gyroid(14.0, 0.0353), sphere_at(0.4013))},
      {"bumpy sphere",
       [](const Place& p) {
         const double bumps = std::sin(9.0 * p[0] + 1.0) * std::sin(8.0 * p[1]) * std::sin(7.0 * p[2] + 2.0);
         return length_of(p[0], p[1], p[2]) - 0.33 - 0.03 * bumps;
       }},
      {"wedge",
       [](const Place& p) {
         const double roof = std::max(0.8 * p[0], -0.8 * p[0]) + 0.6 * p[2] - 0.2113;
         return std::max({roof, -p[2] - 0.2271, std::abs(p[1]) - 0.3037});
       }},
  };
}

/// Corners of the cubes of an R³ grid that have a corner below `reach` cells: inside and a shell around it, or with a
/// large `reach` all of them. Attributes are the linear function linear_attribute; deformation and weights are 0. fp64.
inline double linear_attribute(const Place& p) { return 2.0 * p[0] - p[1] + 0.5 * p[2] + 0.25; }

inline CubeCorners corners_of(const Implicit& distance, std::int64_t resolution, double reach = 1.5) {
  const auto size = static_cast<double>(resolution);
  std::vector<std::int32_t> coords;
  std::vector<double> sdf, attributes;
  for (std::int32_t x = 0; x < resolution; ++x) {
    for (std::int32_t y = 0; y < resolution; ++y) {
      for (std::int32_t z = 0; z < resolution; ++z) {
        std::array<double, 8> values{}, linear{};
        double least = 1e9;
        for (int k = 0; k < 8; ++k) {
          const Place p = {(x + (k & 1)) / size - 0.5, (y + (k >> 1 & 1)) / size - 0.5,
                           (z + (k >> 2 & 1)) / size - 0.5};
          const auto corner = static_cast<std::size_t>(k);
          values[corner] = distance(p);
          linear[corner] = linear_attribute(p);
          least = std::min(least, values[corner]);
        }
        if (least * size > reach) continue;
        coords.insert(coords.end(), {x, y, z});
        sdf.insert(sdf.end(), values.begin(), values.end());
        attributes.insert(attributes.end(), linear.begin(), linear.end());
      }
    }
  }
  const auto count = static_cast<std::int64_t>(coords.size() / 3);
  CubeCorners corners;
  corners.coords = torch::tensor(coords, torch::kInt32).view({count, 3});
  corners.sdf = torch::tensor(sdf, torch::kFloat64).view({count, 8});
  corners.attributes = torch::tensor(attributes, torch::kFloat64).view({count, 8, 1});
  corners.deform = torch::zeros({count, 8, 3}, torch::kFloat64);
  corners.weights = torch::zeros({count, 21}, torch::kFloat64);
  return corners;
}

/// A rough field without any structure: random values of every kind in all cubes of the grid, so that every case and
/// several vertices per cube occur. @param bias added to the signed distances
inline CubeCorners random_corners(std::int64_t resolution, std::int64_t attributes, double bias = 0.0) {
  const Tensor steps = torch::arange(resolution, torch::kInt32);
  const std::vector<Tensor> axes = torch::meshgrid({steps, steps, steps}, "ij");
  CubeCorners corners;
  corners.coords = torch::stack({axes[0].reshape({-1}), axes[1].reshape({-1}), axes[2].reshape({-1})}, 1);
  const std::int64_t count = corners.coords.size(0);
  corners.sdf = torch::randn({count, 8}, torch::kFloat64) + bias;
  corners.deform = torch::randn({count, 8, 3}, torch::kFloat64);
  corners.attributes = torch::randn({count, 8, attributes}, torch::kFloat64);
  corners.weights = torch::randn({count, 21}, torch::kFloat64);
  return corners;
}

}  // namespace anigen::shape_field::test
