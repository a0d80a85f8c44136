#include "anigen/mesh_health/self_intersections.h"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/box_intersection_d.h>
#include <CGAL/intersections.h>

#include "anigen/core/numeric.h"
#include "anigen/core/process.h"
#include "anigen/mesh_health/weld.h"

namespace anigen::mesh_health {

namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point = Kernel::Point_3;
using Box = CGAL::Box_intersection_d::Box_with_info_d<double, 3, std::size_t>;

class PairTest {
 public:
  PairTest(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) : faces_(faces) {
    points_.reserve(vertices.size());
    for (const Eigen::Vector3f& v : vertices) points_.emplace_back(v.x(), v.y(), v.z());
  }

  Kernel::Triangle_3 triangle(std::size_t face) const {
    const Triangle& t = faces_[face];
    return {point(t[0]), point(t[1]), point(t[2])};
  }

  bool cross(std::size_t f, std::size_t g) const {
    const Triangle &a = faces_[f], &b = faces_[g];
    std::size_t common = 0, corner_a = 0, corner_b = 0;  // of the last common vertex
    std::size_t free_a = 3, free_b = 3;                  // sums of the corners that are not common
    for (std::size_t i = 0; i < 3; ++i) {
      for (std::size_t j = 0; j < 3; ++j) {
        if (a[i] != b[j]) continue;
        ++common;
        corner_a = i;
        corner_b = j;
        free_a -= i;
        free_b -= j;
      }
    }
    if (common == 0) return CGAL::do_intersect(triangle(f), triangle(g));
    if (common == 1) {
      // Anything that they share beside the vertex reaches the side opposite to it in one of the two.
      return CGAL::do_intersect(triangle(g), opposite(a, corner_a)) ||
             CGAL::do_intersect(triangle(f), opposite(b, corner_b));
    }
    if (common == 3) return true;
    // Two on one edge share more only when one is folded onto the other.
    const Point &p = point(a[(free_a + 1) % 3]), &q = point(a[(free_a + 2) % 3]);
    const Point &r = point(a[free_a]), &s = point(b[free_b]);
    return CGAL::coplanar(p, q, r, s) && CGAL::coplanar_orientation(p, q, r, s) == CGAL::POSITIVE;
  }

 private:
  const Point& point(std::int32_t vertex) const { return points_[at(vertex)]; }
  Kernel::Segment_3 opposite(const Triangle& face, std::size_t corner) const {
    return {point(face[(corner + 1) % 3]), point(face[(corner + 2) % 3])};
  }

  const std::vector<Triangle>& faces_;
  std::vector<Point> points_;
};

}  // namespace

SelfIntersections self_intersections(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                                     const std::vector<std::size_t>& parts) {
  SelfIntersections result;
  result.same_part.assign(faces.size(), 0);
  result.other_part.assign(faces.size(), 0);
  const PairTest test(vertices, faces);
  std::vector<Box> boxes;
  boxes.reserve(faces.size());
  for (std::size_t f = 0; f < faces.size(); ++f) {
    if (!is_degenerate(vertices, faces[f]) && !test.triangle(f).is_degenerate())
      boxes.emplace_back(test.triangle(f).bbox(), f);
  }
  std::vector<const Box*> pointers;
  pointers.reserve(boxes.size());
  for (const Box& box : boxes) pointers.push_back(&box);
  std::size_t asked = 0;
  constexpr std::size_t kPairsBetweenLooks = 65536;
  CGAL::box_self_intersection_d(pointers.begin(), pointers.end(), [&](const Box* first, const Box* second) {
    if (++asked % kPairsBetweenLooks == 0) throw_if_interrupted();
    const std::size_t f = first->info(), g = second->info();
    if (!test.cross(f, g)) return;
    ++result.pairs;
    std::vector<char>& marks = parts[f] == parts[g] ? result.same_part : result.other_part;
    marks[f] = marks[g] = 1;
  });
  return result;
}

}  // namespace anigen::mesh_health
