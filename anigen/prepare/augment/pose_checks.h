#pragma once
#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/core/json.h"

namespace anigen::prepare {

/// What a pose did to a mesh; "before" is the source's bind pose. Files exist whose animations play the whole object at
/// a hundredth of its bind pose's size. Since posed meshes are normalised again, that is not collapse: everything after
/// `scale` is measured after division by it.
struct PoseMeasures {
  bool finite = true;                  ///< every vertex, and within 1,000 times the source's size
  double scale = 1.0;                  ///< root of the faces' median change of area, each weighted by its area before
  double change = 0.0;                 ///< RMS way of the vertices beyond their mean, over the source's longest side
  double box_ratio = 1.0;              ///< longest side of the bounding box, after / before
  double thickness_ratio = 1.0;        ///< middle side / longest side of the bounding box, after / before
  double area_ratio = 1.0;             ///< surface, after / before
  std::optional<double> volume_ratio;  ///< enclosed volume, after / before; only for a closed, oriented surface
  double shrunk_share = 0.0;           ///< of the surface before: triangles with less than 5 % of their area left
  double stretched_share = 0.0;        ///< of the surface after: triangles with an edge more than 4 times as long
  double buried_share = 0.0;           ///< of the surface: hidden from every direction after, less hidden before
};

/// Limits that a pose must keep. They reject collapse, not style. Set on 59 assets (44 real rigs, 15 creatures) with 6
/// random poses each: but for lumberjack and the tree, which tear in most poses, areas lay within 0.87 … 1.25; volumes
/// lay within 0.80 … 1.07 and shrunk shares below 0.004 everywhere; 92 % kept the stretched share below 0.10, and 97 %
/// the buried share below 0.12. docs/images/augmentation.png shows what passes.
struct PoseLimits {
  double least_scale = 1e-3;
  double least_change = 0.005;
  double least_box = 0.3, most_box = 3.0;
  double least_thickness = 0.25;
  double least_area = 0.75, most_area = 1.3;
  double least_volume = 0.75, most_volume = 1.3;
  double most_shrunk = 0.02;
  double most_stretched = 0.10;
  double most_buried = 0.12;

  /// @throws InputError naming the limit that is negative or not a number
  void validate() const;
};

Json to_json(const PoseMeasures& measures);
Json to_json(const PoseLimits& limits);

/// The first limit that is broken, with its figures ("surface area 0.41 of the source's, at least 0.6"); empty when
/// none is.
std::string broken_limit(const PoseMeasures& measures, const PoseLimits& limits);

/// Measures poses of one mesh: set up once, ask from any thread.
///
/// `buried_share` looks from 400 places, spread over the source's surface and carried along by their triangles, in 32
/// directions over the whole sphere: a place is buried when no ray leaves the mesh. A closed mesh sees half of its
/// rays end inside itself and the rest leave, so this needs neither closed nor consistently oriented surfaces; parts
/// pushed into other parts are counted, and so are folds shut tight. What was hidden before (the inside of a
/// mouth) does not count.
class PoseChecks {
 public:
  /// @throws InputError for a mesh without faces, with a bad index or a vertex that is not finite
  explicit PoseChecks(const Mesh& source);
  ~PoseChecks();
  PoseChecks(PoseChecks&&) noexcept;
  PoseChecks& operator=(PoseChecks&&) noexcept;

  /// @param vertices of the source, moved, [V]; need not be finite @throws InputError when their number differs
  PoseMeasures measure(const std::vector<Eigen::Vector3f>& vertices) const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace anigen::prepare
