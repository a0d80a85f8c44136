#include "anigen/rigging/curve.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <string>
#include <tuple>
#include <unordered_map>
#include <utility>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/curve_skeleton/contraction.h"
#include "anigen/geometry/bones.h"
#include "anigen/geometry/simplify.h"

namespace anigen::rigging {

namespace {

/// Corners of the six tetrahedra of a cell, by bits x, y, z: from 0 to 7 along three edges in each order.
constexpr std::array<std::array<int, 4>, 6> kTetrahedra{
    {{0, 1, 3, 7}, {0, 1, 5, 7}, {0, 2, 3, 7}, {0, 2, 6, 7}, {0, 4, 5, 7}, {0, 4, 6, 7}}};

class TetrahedraMarch {
 public:
  explicit TetrahedraMarch(const SolidField& field) : field_(field) {
    const auto& size = field.grid.size;
    for (int z = 0; z + 1 < size[2]; ++z) {
      for (int y = 0; y + 1 < size[1]; ++y) {
        for (int x = 0; x + 1 < size[0]; ++x) add_cell(x, y, z);
      }
    }
  }

  std::vector<Eigen::Vector3d> vertices;
  std::vector<Triangle> faces;

 private:
  /// Never next to zero: vertices of the surface keep apart from the corners, and so from each other.
  double value(std::size_t node) const {
    const double least = 0.05 * field_.grid.spacing, v = static_cast<double>(field_.distance[node]);
    return v < 0.0 ? std::min(v, -least) : std::max(v, least);
  }

  void add_cell(int x, int y, int z) {
    std::array<std::size_t, 8> nodes{};
    int inside = 0;
    for (int corner = 0; corner < 8; ++corner) {
      nodes[at(corner)] = field_.grid.index(x + (corner & 1), y + (corner >> 1 & 1), z + (corner >> 2));
      inside += field_.distance[nodes[at(corner)]] < 0.0F ? 1 : 0;
    }
    if (inside == 0 || inside == 8) return;
    for (const auto& tetrahedron : kTetrahedra) {
      std::vector<std::size_t> in, out;
      for (const int corner : tetrahedron) {
        const std::size_t node = nodes[at(corner)];
        (field_.distance[node] < 0.0F ? in : out).push_back(node);
      }
      if (in.empty() || out.empty()) continue;
      if (in.size() == 2) {
        const std::array<int, 4> ring{cut(in[0], out[0]), cut(in[0], out[1]), cut(in[1], out[1]), cut(in[1], out[0])};
        add_face(ring[0], ring[1], ring[2], in, out);
        add_face(ring[0], ring[2], ring[3], in, out);
      } else if (in.size() == 1) {
        add_face(cut(in[0], out[0]), cut(in[0], out[1]), cut(in[0], out[2]), in, out);
      } else {
        add_face(cut(in[0], out[0]), cut(in[1], out[0]), cut(in[2], out[0]), in, out);
      }
    }
  }

  Eigen::Vector3d place(std::size_t node) const { return field_.grid.center(node); }

  /// The vertex on the edge between two nodes, one for all tetrahedra around it.
  int cut(std::size_t a, std::size_t b) {
    if (a > b) std::swap(a, b);
    const auto [found, made] = known_.emplace(a * field_.grid.count() + b, static_cast<int>(vertices.size()));
    if (made) {
      const double t = value(a) / (value(a) - value(b));
      vertices.emplace_back((1.0 - t) * place(a) + t * place(b));
    }
    return found->second;
  }

  void add_face(int a, int b, int c, const std::vector<std::size_t>& in, const std::vector<std::size_t>& out) {
    Eigen::Vector3d outward = Eigen::Vector3d::Zero();
    for (const std::size_t node : out) outward += place(node) / static_cast<double>(out.size());
    for (const std::size_t node : in) outward -= place(node) / static_cast<double>(in.size());
    const Eigen::Vector3d normal = (vertices[at(b)] - vertices[at(a)]).cross(vertices[at(c)] - vertices[at(a)]);
    if (normal.dot(outward) < 0.0) std::swap(b, c);
    faces.push_back({a, b, c});
  }

  const SolidField& field_;
  std::unordered_map<std::size_t, int> known_;
};

double volume_of(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& faces) {
  double sum = 0.0;
  for (const Triangle& t : faces) sum += vertices[at(t[0])].dot(vertices[at(t[1])].cross(vertices[at(t[2])])) / 6.0;
  return sum;
}

double apart(const CurveTree& tree, int a, int b) { return (tree.points[at(a)] - tree.points[at(b)]).norm(); }

void link(std::vector<std::vector<int>>& neighbours, int a, int b) {
  neighbours[at(a)].push_back(b);
  neighbours[at(b)].push_back(a);
}

/// The points that are marked, with the links between them.
CurveTree kept_points(const CurveTree& tree, const std::vector<char>& kept) {
  std::vector<int> number(tree.size(), -1);
  CurveTree result;
  for (std::size_t p = 0; p < tree.size(); ++p) {
    if (kept[p] == 0) continue;
    number[p] = static_cast<int>(result.size());
    result.points.push_back(tree.points[p]);
    result.radii.push_back(tree.radii[p]);
  }
  result.neighbours.resize(result.size());
  for (std::size_t p = 0; p < tree.size(); ++p) {
    if (kept[p] == 0) continue;
    for (const int q : tree.neighbours[p]) {
      if (kept[at(q)] != 0) result.neighbours[at(number[p])].push_back(number[at(q)]);
    }
  }
  return result;
}

/// The points from `p` over its neighbour `next` to the next end or branching point.
std::vector<int> walk(const CurveTree& tree, int p, int next) {
  std::vector<int> way{p, next};
  while (tree.degree(way.back()) == 2) {
    const std::vector<int>& around = tree.neighbours[at(way.back())];
    way.push_back(around[around[0] == way[way.size() - 2] ? 1 : 0]);
  }
  return way;
}

/// From an end of the curve to the point before the next branching one.
struct Spur {
  std::vector<int> points;
  int branch = -1;
  double reach = 0.0;  ///< distance from the branch to its farthest point: knots have length but get nowhere
};

Spur spur_at(const CurveTree& tree, int end) {
  Spur spur;
  spur.points = walk(tree, end, tree.neighbours[at(end)].front());
  if (tree.degree(spur.points.back()) == 1) return spur;  // the other end
  spur.branch = spur.points.back();
  spur.points.pop_back();
  for (const int p : spur.points) spur.reach = std::max(spur.reach, apart(tree, p, spur.branch));
  return spur;
}

struct CurveJointRules {
  double bend = 0.0;          ///< a joint goes where the curve is farther than this from the line between two joints
  double longest_bone = 0.0;  ///< bones longer than this are cut into equal parts
};

using Curve = std::vector<Eigen::Vector3d>;

/// Points of a curve between `first` and `last` that its simplification keeps (Ramer 1972, Douglas and Peucker 1973).
void find_bends(const Curve& curve, std::size_t first, std::size_t last, double tolerance,
                std::vector<std::size_t>& kept) {
  std::size_t farthest = first;
  double most = tolerance;
  for (std::size_t i = first + 1; i < last; ++i) {
    const double d = geometry::distance_to_segment(curve[i], curve[first], curve[last]);
    if (d > most) {
      most = d;
      farthest = i;
    }
  }
  if (farthest == first) return;
  find_bends(curve, first, farthest, tolerance, kept);
  kept.push_back(farthest);
  find_bends(curve, farthest, last, tolerance, kept);
}

/// Points evenly along a part of a curve, without its ends.
void add_even_points(const Curve& curve, std::size_t first, std::size_t last, double longest, Curve& joints) {
  double length = 0.0;
  for (std::size_t i = first; i < last; ++i) length += (curve[i + 1] - curve[i]).norm();
  const int parts = std::max(1, static_cast<int>(std::ceil(length / longest - 1e-9)));
  double walked = 0.0;
  int next = 1;
  for (std::size_t i = first; i < last && next < parts; ++i) {
    const double step = (curve[i + 1] - curve[i]).norm();
    for (; next < parts && walked + step >= length * next / parts && step > 0.0; ++next) {
      const double t = std::clamp((length * next / parts - walked) / step, 0.0, 1.0);
      joints.emplace_back((1.0 - t) * curve[i] + t * curve[i + 1]);
    }
    walked += step;
  }
}

/// The joints of a curve between its ends, which are joints already.
Curve joints_along(const Curve& curve, const CurveJointRules& rules) {
  std::vector<std::size_t> kept{0};
  find_bends(curve, 0, curve.size() - 1, rules.bend, kept);
  kept.push_back(curve.size() - 1);
  Curve joints;
  for (std::size_t i = 0; i + 1 < kept.size(); ++i) {
    if (i > 0) joints.push_back(curve[kept[i]]);
    add_even_points(curve, kept[i], kept[i + 1], rules.longest_bone, joints);
  }
  return joints;
}

Eigen::Vector3d center_of_mass(const CurveTree& tree) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double weights = 0.0;
  for (std::size_t p = 0; p < tree.size(); ++p) {
    double length = 0.0;
    for (const int q : tree.neighbours[p]) length += 0.5 * (tree.points[p] - tree.points[at(q)]).norm();
    const double weight = length * tree.radii[p] * tree.radii[p];
    sum += weight * tree.points[p];
    weights += weight;
  }
  return weights > 0.0 ? Eigen::Vector3d(sum / weights) : tree.points[0];
}

/// Joints as an undirected tree.
struct JointNet {
  Curve joints;
  std::vector<std::vector<int>> neighbours;

  int add(const Eigen::Vector3d& joint) {
    joints.push_back(joint);
    neighbours.emplace_back();
    return static_cast<int>(joints.size()) - 1;
  }
};

JointNet joint_net(const CurveTree& tree, const CurveJointRules& rules) {
  JointNet net;
  std::vector<int> joint_of(tree.size(), -1);
  for (std::size_t p = 0; p < tree.size(); ++p) {
    if (tree.neighbours[p].size() != 2) joint_of[p] = net.add(tree.points[p]);
  }
  for (int p = 0; at(p) < tree.size(); ++p) {
    if (joint_of[at(p)] < 0) continue;
    for (const int first : tree.neighbours[at(p)]) {
      const std::vector<int> way = walk(tree, p, first);
      if (way.back() < p) continue;  // seen from its other end
      Curve curve;
      for (const int point : way) curve.push_back(tree.points[at(point)]);
      int last = joint_of[at(p)];
      for (const Eigen::Vector3d& joint : joints_along(curve, rules)) {
        const int added = net.add(joint);
        link(net.neighbours, last, added);
        last = added;
      }
      link(net.neighbours, last, joint_of[at(way.back())]);
    }
  }
  return net;
}

/// Joints at the branches, ends and bends of a curve, and where bones would be too long. The root is the branch (of a
/// curve without one, the joint) nearest to the centre of mass: points weigh length times radius squared.
/// Names are joint_names(). @param tree not empty
Skeleton curve_joints(const CurveTree& tree, const CurveJointRules& rules) {
  const JointNet net = joint_net(tree, rules);
  const Eigen::Vector3d center = center_of_mass(tree);
  const bool branches = std::any_of(net.neighbours.begin(), net.neighbours.end(),
                                    [](const std::vector<int>& around) { return around.size() > 2; });
  int root = -1;
  for (std::size_t j = 0; j < net.joints.size(); ++j) {
    if (branches && net.neighbours[j].size() < 3) continue;
    const bool nearer =
        root < 0 || (net.joints[j] - center).squaredNorm() < (net.joints[at(root)] - center).squaredNorm();
    if (nearer) root = static_cast<int>(j);
  }
  std::vector<int> order{root}, parents{-1}, number(net.joints.size(), -1);
  number[at(root)] = 0;
  for (std::size_t i = 0; i < order.size(); ++i) {
    for (const int next : net.neighbours[at(order[i])]) {
      if (number[at(next)] >= 0) continue;
      number[at(next)] = static_cast<int>(order.size());
      order.push_back(next);
      parents.push_back(static_cast<int>(i));
    }
  }
  std::vector<Eigen::Vector3d> positions;
  for (const int joint : order) positions.push_back(net.joints[at(joint)]);
  return skeleton_from_joints(positions, parents, joint_names(positions, parents));
}

constexpr std::size_t kLeastVertices = 60;  // of a piece
// A surface with handles cannot get below some vertices for each, and takes minutes to contract when it has thousands.
constexpr double kMostHandles = 50.0;
constexpr int kLeastResolution = 8;

void check_curve_options(const CurveSkeletonOptions& options) {
  const auto require = [](bool good, const char* name, const char* range) {
    if (!good) throw InputError("", std::string("curve_skeleton.") + name, std::string("must be ") + range);
  };
  require(options.resolution >= 8 && options.resolution <= 512, "resolution", "8 to 512");
  require(options.target_vertices >= 100 && options.target_vertices <= 100000, "target_vertices", "100 to 100000");
  require(options.most_pieces >= 1, "most_pieces", "1 or more");
  require(options.least_piece >= 0.0 && options.least_piece < 1.0, "least_piece", "0 or more and below 1");
  require(options.spur_radii >= 0.0 && std::isfinite(options.spur_radii), "spur_radii", "0 or more");
  require(options.spur_length >= 0.0 && std::isfinite(options.spur_length), "spur_length", "0 or more");
  require(options.join_radii >= 0.0 && std::isfinite(options.join_radii), "join_radii", "0 or more");
  require(options.bend > 0.0 && std::isfinite(options.bend), "bend", "positive");
  require(options.longest_bone > 0.0, "longest_bone", "positive");
  require(options.most_joints >= 2, "most_joints", "2 or more");
}

/// Curves of several pieces, side by side.
struct Curves {
  std::vector<Eigen::Vector3d> points;
  std::vector<double> radii;
  std::vector<std::array<int, 2>> edges;
};

/// The radius of a point is the mean distance of the surface that went to it, or its depth where that is more: at forks
/// little of the surface arrives.
void add_curve(const ClosedMesh& piece, const SolidField& field, Curves& curves) {
  const curve_skeleton::CurveGraph graph = curve_skeleton::contract_curve(piece.vertices, piece.faces);
  const int before = static_cast<int>(curves.points.size());
  std::vector<double> sums(graph.points.size(), 0.0);
  std::vector<int> counts(graph.points.size(), 0);
  for (std::size_t v = 0; v < piece.vertices.size(); ++v) {
    const auto point = at(graph.point_of_vertex[v]);
    sums[point] += (piece.vertices[v] - graph.points[point]).norm();
    ++counts[point];
  }
  curves.points.insert(curves.points.end(), graph.points.begin(), graph.points.end());
  for (std::size_t p = 0; p < sums.size(); ++p)
    curves.radii.push_back(std::max(counts[p] > 0 ? sums[p] / counts[p] : 0.0, -field.value(graph.points[p])));
  for (const auto& [a, b] : graph.edges) curves.edges.push_back({before + a, before + b});
}

/// Handles of closed surfaces, all together: V − F / 2 is 2 for each piece, less 2 for each handle.
double handles_of(const std::vector<ClosedMesh>& pieces) {
  double handles = 0.0;
  for (const ClosedMesh& piece : pieces)
    handles += 1.0 - 0.5 * (static_cast<double>(piece.vertices.size()) - 0.5 * static_cast<double>(piece.faces.size()));
  return handles;
}

/// The pieces that count.
std::vector<ClosedMesh> large_pieces(const SolidField& field, const CurveSkeletonOptions& options) {
  std::vector<ClosedMesh> pieces = solid_pieces(field);
  if (pieces.empty()) throw InputError("", "mesh", "it encloses nothing that a cell of the grid would notice");
  double volume = 0.0;
  for (const ClosedMesh& piece : pieces) volume += piece.volume;
  if (pieces.size() > options.most_pieces) pieces.resize(options.most_pieces);
  while (pieces.size() > 1 && pieces.back().volume < options.least_piece * volume) pieces.pop_back();
  return pieces;
}

Curves contracted(const std::vector<ClosedMesh>& pieces, const SolidField& field, const CurveSkeletonOptions& options) {
  std::size_t vertices = 0;
  for (const ClosedMesh& piece : pieces) vertices += piece.vertices.size();
  Curves curves;
  for (const ClosedMesh& piece : pieces) {
    const std::size_t share = options.target_vertices * piece.vertices.size() / vertices;
    add_curve(with_fewer_vertices(piece, std::max(kLeastVertices, share)), field, curves);
  }
  return curves;
}

/// A lone point as a short line, since a skeleton without a bone moves nothing.
void require_line(CurveTree& tree, double length) {
  if (tree.size() != 1) return;
  tree.points.emplace_back(tree.points[0] + Eigen::Vector3d(0.0, 0.0, 0.5 * length));
  tree.points[0].z() -= 0.5 * length;
  tree.radii.push_back(tree.radii[0]);
  tree.neighbours = {{1}, {0}};
}

}  // namespace

std::vector<ClosedMesh> solid_pieces(const SolidField& field) {
  const TetrahedraMarch march(field);
  std::vector<int> number(march.vertices.size(), -1);
  std::vector<ClosedMesh> pieces;
  for (const std::vector<int>& faces : connected_faces(march.vertices.size(), march.faces)) {
    ClosedMesh& mesh = pieces.emplace_back();
    for (const int f : faces) {
      Triangle moved = march.faces[at(f)];
      for (int& corner : moved) {
        int& v = number[at(corner)];
        if (v < 0) {
          v = static_cast<int>(mesh.vertices.size());
          mesh.vertices.push_back(march.vertices[at(corner)]);
        }
        corner = v;
      }
      mesh.faces.push_back(moved);
    }
    mesh.volume = volume_of(mesh.vertices, mesh.faces);
  }
  pieces.erase(std::remove_if(pieces.begin(), pieces.end(), [](const ClosedMesh& p) { return !(p.volume > 0.0); }),
               pieces.end());
  std::stable_sort(pieces.begin(), pieces.end(),
                   [](const ClosedMesh& a, const ClosedMesh& b) { return a.volume > b.volume; });
  return pieces;
}

ClosedMesh with_fewer_vertices(const ClosedMesh& mesh, std::size_t target_vertices) {
  if (mesh.vertices.size() <= target_vertices) return mesh;
  std::vector<Eigen::Vector3f> vertices;
  for (const Eigen::Vector3d& v : mesh.vertices) vertices.push_back(v.cast<float>());
  // A closed surface has about twice as many faces as vertices.
  const geometry::Simplified simple = geometry::simplify(vertices, mesh.faces, 2 * target_vertices);
  ClosedMesh result;
  for (const Eigen::Vector3f& v : simple.mesh.vertices) result.vertices.push_back(v.cast<double>());
  result.faces = simple.mesh.faces;
  result.volume = mesh.volume;
  return result;
}

CurveTree curve_tree(const std::vector<Eigen::Vector3d>& points, const std::vector<double>& radii,
                     const std::vector<std::array<int, 2>>& edges) {
  CurveTree tree;
  tree.points = points;
  tree.radii = radii;
  tree.neighbours.resize(points.size());
  DisjointSets sets(points.size());
  std::vector<std::tuple<double, int, int>> order;
  for (const auto& [a, b] : edges) order.emplace_back(-std::min(radii[at(a)], radii[at(b)]), a, b);
  std::sort(order.begin(), order.end());
  for (const auto& [thin, a, b] : order) {
    if (sets.join(at(a), at(b))) link(tree.neighbours, a, b);
  }
  std::vector<std::tuple<double, int, int>> gaps;
  for (int a = 0; at(a) < points.size(); ++a) {
    for (int b = a + 1; at(b) < points.size(); ++b) {
      if (!sets.same(at(a), at(b))) gaps.emplace_back(apart(tree, a, b), a, b);
    }
  }
  std::sort(gaps.begin(), gaps.end());
  for (const auto& [gap, a, b] : gaps) {
    if (sets.join(at(a), at(b))) link(tree.neighbours, a, b);
  }
  for (auto& list : tree.neighbours) std::sort(list.begin(), list.end());
  return tree;
}

CurveTree without_spurs(CurveTree tree, double radii, double length) {
  while (true) {
    Spur shortest;
    for (int p = 0; at(p) < tree.size(); ++p) {
      if (tree.degree(p) != 1) continue;
      Spur spur = spur_at(tree, p);
      if (spur.branch < 0) continue;
      if (!(spur.reach < std::max(length, radii * tree.radii[at(spur.branch)]))) continue;
      if (shortest.branch < 0 || spur.reach < shortest.reach) shortest = std::move(spur);
    }
    if (shortest.branch < 0) return tree;
    std::vector<char> kept(tree.size(), 1);
    for (const int p : shortest.points) kept[at(p)] = 0;
    tree = kept_points(tree, kept);
  }
}

CurveTree with_joined_branches(CurveTree tree, double radii) {
  while (true) {
    // The two neighbouring branching points that are nearest to each other for their size.
    std::vector<int> nearest;
    double least = radii;
    for (int p = 0; at(p) < tree.size(); ++p) {
      if (tree.degree(p) < 3) continue;
      for (const int first : tree.neighbours[at(p)]) {
        const std::vector<int> way = walk(tree, p, first);
        double length = 0.0;
        for (std::size_t i = 1; i < way.size(); ++i) length += apart(tree, way[i - 1], way[i]);
        const int q = way.back();
        if (tree.degree(q) < 3 || q < p) continue;
        const double relative = length / std::max({tree.radii[at(p)], tree.radii[at(q)], 1e-12});
        if (!(relative < least)) continue;
        least = relative;
        nearest = way;
      }
    }
    if (nearest.empty()) return tree;
    const int p = nearest.front(), q = nearest.back();
    const double rp = tree.radii[at(p)], rq = tree.radii[at(q)];
    tree.points[at(p)] = (rp * tree.points[at(p)] + rq * tree.points[at(q)]) / std::max(rp + rq, 1e-12);
    tree.radii[at(p)] = std::max(rp, rq);
    std::vector<char> kept(tree.size(), 1);
    for (std::size_t i = 1; i < nearest.size(); ++i) kept[at(nearest[i])] = 0;
    for (const int other : std::vector<int>(tree.neighbours[at(q)])) {
      if (other == nearest[nearest.size() - 2]) continue;
      link(tree.neighbours, p, other);
    }
    tree = kept_points(tree, kept);
    for (auto& list : tree.neighbours) std::sort(list.begin(), list.end());
  }
}

Skeleton propose_curve_skeleton(const Mesh& mesh, const CurveSkeletonOptions& options) {
  check_curve_options(options);
  if (!curve_skeleton::can_contract())
    throw NotSupportedError("", "curve skeleton", "a build without CGAL (CMake option ANIGEN_WITH_CGAL)");
  SolidField field = solid_field(mesh, 1.0, options.resolution);
  std::vector<ClosedMesh> pieces = large_pieces(field, options);
  for (int cells = options.resolution / 2; cells >= kLeastResolution && handles_of(pieces) > kMostHandles; cells /= 2) {
    field = solid_field(mesh, 1.0, cells);
    pieces = large_pieces(field, options);
  }
  const Curves curves = contracted(pieces, field, options);
  const CurveTree whole = curve_tree(curves.points, curves.radii, curves.edges);
  Skeleton skeleton;
  for (double coarser = 1.0;; coarser *= 1.25) {
    CurveTree tree = without_spurs(whole, options.spur_radii * coarser, options.spur_length * coarser);
    tree = with_joined_branches(std::move(tree), options.join_radii * coarser);
    require_line(tree, 0.02);
    CurveJointRules rules;
    rules.bend = options.bend * coarser;
    rules.longest_bone = options.longest_bone * coarser;
    skeleton = curve_joints(tree, rules);
    // At a hundredfold there are no spurs, branches or bends left, and two joints.
    if (skeleton.size() <= options.most_joints || coarser > 1e4) break;
  }
  std::vector<Eigen::Vector3d> joints = skeleton.positions();
  for (Eigen::Vector3d& joint : joints) joint = (joint - field.from_mesh.offset) / field.from_mesh.scale;
  return skeleton_from_joints(joints, skeleton.parents, skeleton.names);
}

}  // namespace anigen::rigging
