#include "anigen/geometry/fill_holes.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <set>
#include <unordered_set>
#include <utility>

#include "anigen/core/numeric.h"
#include "anigen/geometry/hidden_faces.h"

namespace anigen::geometry {

namespace {

constexpr std::int32_t kNone = -1;

struct BoundaryLoops {
  /// Vertices along each hole, at least three and none twice, in the direction of the sides of the faces around it: a
  /// face that closes part of the hole has to run against it. Where holes touch themselves in a vertex they are
  /// several.
  std::vector<std::vector<std::int32_t>> loops;
  std::size_t broken = 0;  ///< borders that run into an edge of more than two faces or along faces that disagree about
                           ///< which side is up: they surround nothing that a face could close
};

/// The closed walks along edges with one face. @pre no face names a vertex twice
class BorderWalk {
 public:
  BorderWalk(const std::vector<Triangle>& faces, const MeshEdges& edges)
      : faces_(faces), edges_(edges), visited_(edges.size(), 0) {}

  BoundaryLoops run() {
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      if (edges_.faces(e).size() != 1 || visited_[e] != 0) continue;
      std::vector<std::int32_t> walk;
      if (follow(static_cast<std::int32_t>(e), walk)) {
        split(walk);
      } else {
        ++result_.broken;
      }
    }
    return std::move(result_);
  }

 private:
  /// The only face of a border edge.
  std::int32_t face_of(std::int32_t edge) const { return *edges_.faces(at(edge)).first; }

  /// Start and end of a border edge in the direction of its face.
  std::pair<std::int32_t, std::int32_t> directed(std::int32_t edge) const {
    const std::size_t face = at(face_of(edge));
    std::size_t side = 0;
    while (edges_.of_face(face, side) != edge) ++side;
    return {faces_[face][side], faces_[face][(side + 1) % 3]};
  }

  /// The side of the face that is not `edge` but ends in `pivot` too.
  std::int32_t other_side(std::int32_t face, std::int32_t edge, std::int32_t pivot) const {
    for (std::size_t side = 0; side < 3; ++side) {
      const std::int32_t other = edges_.of_face(at(face), side);
      if (other == edge) continue;
      const MeshEdges::Edge& ends = edges_[at(other)];
      if (ends[0] == pivot || ends[1] == pivot) return other;
    }
    return kNone;
  }

  /// The border edge at the other end of the faces around `pivot` that begin with this one; kNone when they end at an
  /// edge of more than two faces.
  std::int32_t next_border(std::int32_t edge, std::int32_t pivot) const {
    std::int32_t face = face_of(edge);
    for (;;) {
      edge = other_side(face, edge, pivot);
      const MeshEdges::Faces both = edges_.faces(at(edge));
      if (both.size() == 1) return edge;
      if (both.size() > 2) return kNone;
      face = both.first[0] == face ? both.first[1] : both.first[0];
    }
  }

  /// Walks from an edge back to it and marks what it passes. @return false when that is not possible
  bool follow(std::int32_t start, std::vector<std::int32_t>& walk) {
    std::int32_t edge = start;
    do {
      visited_[at(edge)] = 1;
      const auto [from, to] = directed(edge);
      walk.push_back(from);
      const std::int32_t next = next_border(edge, to);
      if (next == kNone) return false;
      if (directed(next).first != to) return false;  // these faces disagree about which side is up
      edge = next;
    } while (visited_[at(edge)] == 0);
    return edge == start;
  }

  /// Cuts a walk where it comes back to a vertex, so that every loop passes each vertex once.
  void split(const std::vector<std::int32_t>& walk) {
    std::vector<std::int32_t> open;
    std::unordered_set<std::int32_t> is_open;
    for (const std::int32_t vertex : walk) {
      if (!is_open.insert(vertex).second) {
        const auto before = std::find(open.begin(), open.end(), vertex);
        for (auto after = before + 1; after != open.end(); ++after) is_open.erase(*after);
        add({before, open.end()});
        open.erase(before, open.end());
      }
      open.push_back(vertex);
    }
    add(std::move(open));
  }

  void add(std::vector<std::int32_t> loop) {
    if (loop.size() >= 3) result_.loops.push_back(std::move(loop));
  }

  const std::vector<Triangle>& faces_;
  const MeshEdges& edges_;
  std::vector<char> visited_;
  BoundaryLoops result_;
};

constexpr double kImpossible = std::numeric_limits<double>::infinity();
/// Bends are compared in steps of this: among those that differ by rounding alone the area decides.
constexpr double kBendStep = 1e-6;

/// The sharpest bend, 0 flat to 2 folded back, and the area.
struct Weight {
  double bend = 0.0, area = 0.0;

  bool operator<(const Weight& other) const {
    return bend < other.bend - kBendStep || (bend < other.bend + kBendStep && area < other.area);
  }
};

/// The best way to close the polygon from point i to point k along the outline and straight back.
struct Span {
  Weight weight;
  std::int32_t apex = -1;  ///< of the triangle at the edge from k to i
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
};

/// A hole as a closed polygon and what surrounds it.
struct HoleOutline {
  std::vector<Eigen::Vector3d> points;   ///< [n] along the hole, against the direction of the faces around it
  std::vector<Eigen::Vector3d> outside;  ///< [n] unit normal of the face beyond the edge from point i to the next
  /// True when an edge between two points of the outline that are not next to each other may be made.
  std::function<bool(std::int32_t, std::int32_t)> may_connect;
};

/// The triangulation of a hole without new points that bends least: the one with the smallest of the largest angles
/// between faces that share an edge, of equal ones the one with the least area (Barequet and Sharir 1995 with the
/// weights of Liepa 2003). Time grows with n³, memory with n². run() returns n − 2 triangles of indices into the
/// outline, in its direction; none when the forbidden edges leave none.
class Triangulation {
 public:
  explicit Triangulation(const HoleOutline& hole)
      : hole_(hole),
        size_(static_cast<std::int32_t>(hole.points.size())),
        spans_(hole.points.size() * hole.points.size()) {}

  std::vector<Triangle> run() {
    for (std::int32_t i = 0; i + 1 < size_; ++i) span(i, i + 1).normal = hole_.outside[at(i)];
    for (std::int32_t length = 2; length < size_; ++length) {
      for (std::int32_t i = 0; i + length < size_; ++i) close(i, i + length);
    }
    std::vector<Triangle> triangles;
    if (span(0, size_ - 1).weight.bend == kImpossible) return triangles;
    collect(0, size_ - 1, triangles);
    return triangles;
  }

 private:
  Span& span(std::int32_t i, std::int32_t k) { return spans_[at(i) * at(size_) + at(k)]; }

  static double bend(const Eigen::Vector3d& first, const Eigen::Vector3d& second) { return 1.0 - first.dot(second); }

  void close(std::int32_t i, std::int32_t k) {
    Span& best = span(i, k);
    best.weight.bend = kImpossible;
    const bool is_whole = k - i == size_ - 1;
    if (!is_whole && !hole_.may_connect(i, k)) return;
    for (std::int32_t m = i + 1; m < k; ++m) {
      const Span &before = span(i, m), &after = span(m, k);
      if (before.weight.bend == kImpossible || after.weight.bend == kImpossible) continue;
      const Eigen::Vector3d& a = hole_.points[at(i)];
      const Eigen::Vector3d cross = (hole_.points[at(m)] - a).cross(hole_.points[at(k)] - a);
      const double twice_area = cross.norm();
      // A triangle without area has no normal: it bends by a right angle whatever it touches.
      const Eigen::Vector3d normal = twice_area > 0.0 ? Eigen::Vector3d(cross / twice_area) : Eigen::Vector3d::Zero();
      Weight weight;
      weight.bend =
          std::max({before.weight.bend, after.weight.bend, bend(normal, before.normal), bend(normal, after.normal)});
      if (is_whole) weight.bend = std::max(weight.bend, bend(normal, hole_.outside[at(k)]));
      weight.area = before.weight.area + after.weight.area + 0.5 * twice_area;
      if (best.apex < 0 || weight < best.weight) best = {weight, m, normal};
    }
  }

  void collect(std::int32_t i, std::int32_t k, std::vector<Triangle>& triangles) {
    if (k == i + 1) return;
    const std::int32_t m = span(i, k).apex;
    triangles.push_back({i, m, k});
    collect(i, m, triangles);
    collect(m, k, triangles);
  }

  const HoleOutline& hole_;
  std::int32_t size_;
  std::vector<Span> spans_;
};

/// Largest size of a triangle relative to its surroundings (Liepa's α).
const double kDensity = std::sqrt(2.0);
constexpr int kMostRounds = 50;          ///< of adding points: each halves the size at least
constexpr std::size_t kMostTurns = 100;  ///< times the number of faces: turning edges ends by itself but for rounding

using DirectedEdge = std::array<std::int32_t, 2>;

/// Triangles that close a hole.
struct HolePatch {
  std::vector<Eigen::Vector3d> points;  ///< those of the outline first, in its order
  std::vector<Triangle> faces;
  std::int32_t outline = 0;  ///< how many points belong to the outline
};

/// Gives a patch triangles of about the size of those around it: adds points in the middle of large triangles and turns
/// edges towards larger angles, until neither has anything to do (Liepa 2003, section 4). The outline stays. `scale`:
/// how long edges should be at each point, the mean of the surface around it.
class Refinement {
 public:
  Refinement(HolePatch& patch, std::vector<double> scale,
             const std::function<bool(std::int32_t, std::int32_t)>& may_connect)
      : patch_(patch), scale_(std::move(scale)), may_connect_(may_connect) {
    for (std::size_t f = 0; f < patch_.faces.size(); ++f) enter(f);
  }

  void run() {
    for (int round = 0; round < kMostRounds; ++round) {
      if (!add_points()) return;
      turn_edges();
    }
  }

 private:
  const Eigen::Vector3d& point(std::int32_t index) const { return patch_.points[at(index)]; }

  void enter(std::size_t face) {
    const Triangle& t = patch_.faces[face];
    for (std::size_t k = 0; k < 3; ++k) side_of_[{t[k], t[(k + 1) % 3]}] = face;
  }

  bool add_points() {
    bool added = false;
    const std::size_t count = patch_.faces.size();
    for (std::size_t f = 0; f < count; ++f) {
      const Triangle t = patch_.faces[f];
      const Eigen::Vector3d middle = (point(t[0]) + point(t[1]) + point(t[2])) / 3.0;
      const double scale = (scale_[at(t[0])] + scale_[at(t[1])] + scale_[at(t[2])]) / 3.0;
      const bool is_large = std::all_of(t.begin(), t.end(), [&](std::int32_t corner) {
        const double reach = kDensity * (point(corner) - middle).norm();
        return reach > scale && reach > scale_[at(corner)];
      });
      if (!is_large) continue;
      const auto center = static_cast<std::int32_t>(patch_.points.size());
      patch_.points.push_back(middle);
      scale_.push_back(scale);
      patch_.faces[f] = {t[0], t[1], center};
      patch_.faces.push_back({t[1], t[2], center});
      patch_.faces.push_back({t[2], t[0], center});
      for (const std::size_t changed : {f, patch_.faces.size() - 2, patch_.faces.size() - 1}) enter(changed);
      added = true;
    }
    return added;
  }

  /// Turns edges until none has opposite angles of more than 180° together.
  void turn_edges() {
    std::vector<std::size_t> waiting(patch_.faces.size());
    for (std::size_t f = 0; f < waiting.size(); ++f) waiting[f] = f;
    std::size_t turns_left = kMostTurns * patch_.faces.size();
    while (!waiting.empty() && turns_left > 0) {
      const std::size_t face = waiting.back();
      waiting.pop_back();
      for (std::size_t k = 0; k < 3; ++k) {
        const auto back = side_of_.find({patch_.faces[face][(k + 1) % 3], patch_.faces[face][k]});
        if (back == side_of_.end()) continue;
        const std::size_t other = back->second;  // turn() removes what `back` points to
        if (!turn(face, k, other)) continue;
        waiting.push_back(face);
        waiting.push_back(other);
        --turns_left;
        break;
      }
    }
  }

  static double angle(const Eigen::Vector3d& at_point, const Eigen::Vector3d& first, const Eigen::Vector3d& second) {
    const Eigen::Vector3d a = first - at_point, b = second - at_point;
    return std::atan2(a.cross(b).norm(), a.dot(b));
  }

  /// True when the patch or the mesh around it has no edge between the two yet.
  bool is_free(std::int32_t a, std::int32_t b) const {
    if (side_of_.count({a, b}) > 0 || side_of_.count({b, a}) > 0) return false;
    return a >= patch_.outline || b >= patch_.outline || may_connect_(a, b);
  }

  /// Puts the edge from corner k of a face to the next, which it shares with `other`, between the third corners
  /// instead, if those are the larger angles. @return whether it did
  bool turn(std::size_t face, std::size_t k, std::size_t other) {
    const std::int32_t a = patch_.faces[face][k], b = patch_.faces[face][(k + 1) % 3],
                       c = patch_.faces[face][(k + 2) % 3];
    const Triangle& t = patch_.faces[other];
    const std::int32_t d = *std::find_if(t.begin(), t.end(), [&](std::int32_t v) { return v != a && v != b; });
    constexpr double kStraight = kPi + 1e-9;
    if (angle(point(c), point(a), point(b)) + angle(point(d), point(a), point(b)) <= kStraight) return false;
    if (c == d || !is_free(c, d)) return false;
    // The two angles at a (and at b) become one; more than 180° there would fold the patch.
    for (const std::int32_t end : {a, b}) {
      const std::int32_t far = end == a ? b : a;
      const double both = angle(point(end), point(c), point(far)) + angle(point(end), point(far), point(d));
      if (both >= kStraight) return false;
    }
    side_of_.erase({a, b});
    side_of_.erase({b, a});
    patch_.faces[face] = {c, a, d};
    patch_.faces[other] = {d, b, c};
    enter(face);
    enter(other);
    return true;
  }

  HolePatch& patch_;
  std::vector<double> scale_;
  const std::function<bool(std::int32_t, std::int32_t)>& may_connect_;
  std::map<DirectedEdge, std::size_t> side_of_;  ///< face that runs along an edge in this direction
};

using Loop = std::vector<std::int32_t>;

class HoleFiller {
 public:
  HoleFiller(const std::vector<Eigen::Vector3f>& vertices, std::vector<Triangle> faces)
      : edges_(faces, vertices.size()) {
    mesh_.vertices = vertices;
    mesh_.faces = std::move(faces);
    scale_sums_.assign(vertices.size(), 0.0);
    scale_counts_.assign(vertices.size(), 0);
    for (const MeshEdges::Edge& edge : edges_.all()) {
      const double length = (position(edge[0]) - position(edge[1])).norm();
      for (const std::int32_t vertex : edge) {
        scale_sums_[at(vertex)] += length;
        ++scale_counts_[at(vertex)];
      }
    }
  }

  FilledMesh run(const HoleFilling& options) {
    FilledMesh result;
    BoundaryLoops borders = BorderWalk(mesh_.faces, edges_).run();
    result.broken = borders.broken;
    for (Loop& loop : borders.loops) {
      const bool closed = loop.size() <= options.most_edges && fill(loop, options.refine);
      ++(closed ? result.filled : result.left_open);
    }
    result.mesh = std::move(mesh_);
    return result;
  }

 private:
  Eigen::Vector3d position(std::int32_t vertex) const { return mesh_.vertices[at(vertex)].cast<double>(); }

  const Triangle& face_at(std::int32_t a, std::int32_t b) const {
    return mesh_.faces[at(*edges_.faces(at(edges_.find(a, b))).first)];
  }

  bool is_free(std::int32_t a, std::int32_t b) const {
    return edges_.find(a, b) < 0 && made_.count({std::min(a, b), std::max(a, b)}) == 0;
  }

  bool fill(Loop loop, bool refine) {
    // New faces run against the sides of the old ones.
    std::reverse(loop.begin(), loop.end());
    if (loop.size() == 3 && is_on_its_face(loop)) return false;
    HoleOutline outline;
    for (std::size_t i = 0; i < loop.size(); ++i) {
      outline.points.push_back(position(loop[i]));
      outline.outside.push_back(face_normal(mesh_.vertices, face_at(loop[i], loop[(i + 1) % loop.size()])));
    }
    outline.may_connect = [&](std::int32_t a, std::int32_t b) { return is_free(loop[at(a)], loop[at(b)]); };
    std::vector<double> scale;
    for (const std::int32_t vertex : loop)
      scale.push_back(scale_sums_[at(vertex)] / static_cast<double>(scale_counts_[at(vertex)]));
    HolePatch patch{outline.points, Triangulation(outline).run(), static_cast<std::int32_t>(loop.size())};
    if (patch.faces.empty()) add_fan(patch, scale);
    if (refine) Refinement(patch, scale, outline.may_connect).run();
    append(patch, loop);
    return true;
  }

  /// The loop around a triangle that stands alone: its patch would be the same triangle from behind.
  bool is_on_its_face(const Loop& loop) const {
    const Triangle& face = face_at(loop[0], loop[1]);
    return std::find(face.begin(), face.end(), loop[2]) != face.end();
  }

  static void add_fan(HolePatch& patch, std::vector<double>& scale) {
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();
    double mean_scale = 0.0;
    const std::int32_t count = patch.outline;
    for (std::int32_t i = 0; i < count; ++i) {
      middle += patch.points[at(i)] / count;
      mean_scale += scale[at(i)] / count;
      patch.faces.push_back({i, (i + 1) % count, count});
    }
    patch.points.push_back(middle);
    scale.push_back(mean_scale);
  }

  void append(const HolePatch& patch, const Loop& loop) {
    const auto first_new = static_cast<std::int32_t>(mesh_.vertices.size());
    for (std::size_t i = loop.size(); i < patch.points.size(); ++i)
      mesh_.vertices.push_back(patch.points[i].cast<float>());
    for (Triangle face : patch.faces) {
      for (std::int32_t& corner : face)
        corner = corner < patch.outline ? loop[at(corner)] : first_new + corner - patch.outline;
      mesh_.faces.push_back(face);
      for (std::size_t k = 0; k < 3; ++k) made_.insert(std::minmax(face[k], face[(k + 1) % 3]));
    }
  }

  MeshEdges edges_;  ///< of the mesh as it came
  Mesh mesh_;
  std::vector<double> scale_sums_;
  std::vector<std::size_t> scale_counts_;
  std::set<std::pair<std::int32_t, std::int32_t>> made_;  ///< edges of patches
};

}  // namespace

FilledMesh fill_holes(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                      const HoleFilling& options) {
  return HoleFiller(vertices, proper_faces(faces)).run(options);
}

}  // namespace anigen::geometry
