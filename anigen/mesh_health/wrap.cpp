#include "anigen/mesh_health/wrap.h"

#include <CGAL/alpha_wrap_3.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <utility>

#include "anigen/core/process.h"
#include "anigen/mesh_health/cgal_mesh.h"
#include "anigen/mesh_health/weld.h"

namespace anigen::mesh_health {

namespace {

/// Shares of the diagonal. A wrap of this alpha has some thousands of faces, whatever it encloses.
constexpr double kCoarseAlpha = 0.04, kLeastShare = 1e-6;
/// Of a triangulated closed surface.
constexpr std::size_t kFacesPerVertex = 2;

/// Stops when asked to, or when more vertices were inserted than there may be faces: a surface has half as many, and
/// not every insertion ends on it.
class Watch : public CGAL::Alpha_wraps_3::internal::Wrapping_default_visitor {
 public:
  Watch(std::size_t expected_vertices, std::size_t most_faces, StepReport report)
      : expected_(std::max<std::size_t>(expected_vertices, 1)), most_(most_faces), report_(std::move(report)) {}

  template <typename Wrapper, typename Vertex>
  void after_Steiner_point_insertion(const Wrapper&, Vertex) {
    constexpr std::size_t kBetweenLooks = 256;
    if (++inserted_ % kBetweenLooks != 0) return;
    throw_if_interrupted();
    if (report_) report_(std::min(inserted_, expected_), expected_);
    if (inserted_ > most_) {
      throw InputError("", "alpha",
                       "gives more than " + std::to_string(most_) +
                           " faces, more than the mesh's size made expect; choose a larger one");
    }
  }

 private:
  std::size_t expected_, most_, inserted_ = 0;
  StepReport report_;
};

std::string number_text(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2g", value);
  return text;
}

/// The mesh and its scale, checked.
struct WrapInput {
  std::vector<Point> points;
  std::vector<std::array<std::size_t, 3>> faces;
  double diagonal = 0.0;
};

WrapInput wrap_input(const Mesh& mesh, const WrapOptions& options) {
  if (!(options.alpha >= kLeastShare && options.alpha <= 1))
    throw InputError("", "alpha", "must be a share of the diagonal from 0.000001 to 1");
  if (options.offset != 0 && !(options.offset >= kLeastShare && options.offset <= 1))
    throw InputError("", "offset", "must be 0 or a share of the diagonal from 0.000001 to 1");
  const WeldedMesh welded = weld(mesh);
  WrapInput input;
  Box box;
  for (const Triangle& face : welded.faces) {
    if (is_degenerate(welded.places, face)) continue;
    input.faces.push_back({at(face[0]), at(face[1]), at(face[2])});
    for (const std::int32_t v : face) box.extend(welded.places[at(v)].cast<double>());
  }
  if (input.faces.empty()) throw InputError("", "mesh.faces", "no face has an area");
  for (const Eigen::Vector3f& p : welded.places) input.points.emplace_back(p.x(), p.y(), p.z());
  input.diagonal = box.diagonal();
  return input;
}

Mesh wrapped(const WrapInput& input, double alpha, double offset, Watch& watch) {
  SurfaceMesh surface;
  try {
    CGAL::alpha_wrap_3(input.points, input.faces, alpha * input.diagonal, offset * input.diagonal, surface,
                       CGAL::parameters::default_values(), CGAL::parameters::visitor(std::ref(watch)));
  } catch (const Error&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    throw Error(std::string("the mesh could not be wrapped: ") + error.what());
  }
  Mesh mesh = to_mesh(surface);
  if (mesh.faces.empty()) throw Error("the wrap is empty");
  return mesh;
}

std::size_t scaled_up(std::size_t coarse_faces, double alpha) {
  const double finer = std::max(1.0, kCoarseAlpha / alpha);
  return static_cast<std::size_t>(std::min(1e15, static_cast<double>(coarse_faces) * finer * finer));
}

std::size_t estimate_from(const WrapInput& input, const WrapOptions& options) {
  const double alpha = std::max(options.alpha, kCoarseAlpha);
  Watch watch(0, options.most_faces, {});
  return scaled_up(wrapped(input, alpha, alpha / 30.0, watch).faces.size(), options.alpha);
}

}  // namespace

std::size_t estimated_wrap_faces(const Mesh& mesh, const WrapOptions& options) {
  return estimate_from(wrap_input(mesh, options), options);
}

Mesh wrap(const Mesh& mesh, const WrapOptions& options, const StepReport& report) {
  const WrapInput input = wrap_input(mesh, options);
  const std::size_t expected = estimate_from(input, options);
  if (expected > options.most_faces) {
    const double possible =
        options.alpha * std::sqrt(static_cast<double>(expected) / static_cast<double>(options.most_faces));
    throw InputError("", "alpha",
                     "would give about " + std::to_string(expected) + " faces, and " +
                         std::to_string(options.most_faces) + " are the most; from about " +
                         number_text(1.05 * possible) + " on there are fewer");
  }
  const double offset = options.offset > 0 ? options.offset : std::max(kLeastShare, options.alpha / 30.0);
  Watch watch(expected / kFacesPerVertex, options.most_faces, report);
  return wrapped(input, options.alpha, offset, watch);
}

}  // namespace anigen::mesh_health
