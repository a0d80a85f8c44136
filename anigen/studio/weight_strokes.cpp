#include "anigen/studio/weight_strokes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/studio/rebind.h"

namespace anigen::studio {

namespace {

constexpr std::size_t kMostStrokes = 5000;
constexpr std::size_t kUsualInfluences = 4;

using Row = std::vector<Influence>;

float& weight_of(Row& row, int joint) {
  const auto found = std::find_if(row.begin(), row.end(), [&](const Influence& one) { return one.joint == joint; });
  if (found != row.end()) return found->weight;
  return row.emplace_back(Influence{joint, 0.0F}).weight;
}

/// Vertices of a mesh that are at one place, and the places that edges join.
class Places {
 public:
  explicit Places(const Mesh& mesh) : of_vertex_(mesh.vertices.size()) {
    const auto key = [&](std::size_t v) {
      return std::array<float, 3>{mesh.vertices[v].x(), mesh.vertices[v].y(), mesh.vertices[v].z()};
    };
    members_.resize(mesh.vertices.size());
    std::iota(members_.begin(), members_.end(), std::size_t{0});
    std::sort(members_.begin(), members_.end(), [&](std::size_t a, std::size_t b) { return key(a) < key(b); });
    for (std::size_t i = 0; i < members_.size(); ++i) {
      if (i == 0 || key(members_[i]) != key(members_[i - 1])) first_member_.push_back(i);
      of_vertex_[members_[i]] = first_member_.size() - 1;
    }
    first_member_.push_back(members_.size());
    for (const Triangle& face : mesh.faces) {
      for (std::size_t side = 0; side < 3; ++side) {
        const std::size_t a = of_vertex_[at(face[side])], b = of_vertex_[at(face[(side + 1) % 3])];
        if (a == b) continue;
        neighbours_.emplace_back(a, b);
        neighbours_.emplace_back(b, a);
      }
    }
    std::sort(neighbours_.begin(), neighbours_.end());
    neighbours_.erase(std::unique(neighbours_.begin(), neighbours_.end()), neighbours_.end());
  }

  /// Mean over the places that edges join with that of a vertex, of the mean rows there; empty where there are none.
  Row mean_around(std::size_t vertex, const std::vector<Row>& rows) const {
    const std::size_t here = of_vertex_[vertex];
    const auto begin = std::lower_bound(neighbours_.begin(), neighbours_.end(), std::make_pair(here, std::size_t{0}));
    const auto end = std::lower_bound(begin, neighbours_.end(), std::make_pair(here + 1, std::size_t{0}));
    Row mean;
    for (auto joined = begin; joined != end; ++joined) {
      const std::size_t first = first_member_[joined->second], last = first_member_[joined->second + 1];
      const double share = 1.0 / (static_cast<double>(end - begin) * static_cast<double>(last - first));
      for (std::size_t i = first; i < last; ++i)
        for (const Influence& influence : rows[members_[i]])
          weight_of(mean, influence.joint) += static_cast<float>(share * influence.weight);
    }
    return mean;
  }

 private:
  std::vector<std::size_t> of_vertex_;                           ///< place per vertex
  std::vector<std::size_t> members_, first_member_;              ///< vertices by place, and where each place begins
  std::vector<std::pair<std::size_t, std::size_t>> neighbours_;  ///< places, sorted
};

void scale(Row& row, double factor) {
  for (Influence& influence : row) influence.weight = static_cast<float>(influence.weight * factor);
}

void add_weight(Row& row, int joint, double amount) {
  scale(row, 1.0 - amount);
  weight_of(row, joint) += static_cast<float>(amount);
}

void remove_weight(Row& row, int joint, int parent, double amount) {
  const double before = weight_of(row, joint), after = before * (1.0 - amount), others = 1.0 - before;
  constexpr double kNothing = 1e-6;
  if (others > kNothing) {
    scale(row, (1.0 - after) / others);
    weight_of(row, joint) = static_cast<float>(after);
  } else if (parent >= 0) {
    weight_of(row, joint) = static_cast<float>(after);
    weight_of(row, parent) += static_cast<float>(before - after);
  }
}

void mix(Row& row, const Row& other, double amount) {
  if (other.empty()) return;
  scale(row, 1.0 - amount);
  for (const Influence& one : other) weight_of(row, one.joint) += static_cast<float>(amount * one.weight);
}

/// Vertices that a stroke reaches, with its amount there.
std::vector<std::pair<std::size_t, double>> reached(const Stroke& stroke, const Mesh& mesh) {
  std::vector<std::pair<std::size_t, double>> found;
  const double radius = stroke.radius * stroke.radius;
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const double far = (mesh.vertices[v].cast<double>() - stroke.center).squaredNorm() / radius;
    if (far < 1.0) found.emplace_back(v, stroke.strength * (1.0 - far) * (1.0 - far));
  }
  return found;
}

}  // namespace

std::vector<Stroke> parse_strokes(const Json& strokes, const Skeleton& skeleton) {
  constexpr const char* kPlace = "strokes";
  if (!strokes.is_array() || strokes.size() > kMostStrokes)
    throw InputError(kPlace, "", "is no list of at most " + std::to_string(kMostStrokes) + " strokes");
  std::vector<Stroke> parsed;
  for (std::size_t i = 0; i < strokes.size(); ++i) {
    ConfigReader reader(strokes[i], kPlace, "/" + std::to_string(i));
    for (const char* key : {"center", "radius"}) reader.require(key);
    Stroke stroke;
    const std::string mode = reader.choice("mode", "add", {"add", "remove", "smooth"});
    stroke.mode = mode == "add" ? Stroke::Mode::kAdd : mode == "remove" ? Stroke::Mode::kRemove : Stroke::Mode::kSmooth;
    const std::string name = reader.text("joint", "");
    const auto joint = std::find(skeleton.names.begin(), skeleton.names.end(), name);
    const bool needed = stroke.mode != Stroke::Mode::kSmooth;
    if (needed && joint == skeleton.names.end()) throw reader.error("joint", "\"" + name + "\" is no joint");
    stroke.joint = needed ? static_cast<int>(joint - skeleton.names.begin()) : 0;
    stroke.center = world_position(reader.numbers("center", {}), reader, "center");
    stroke.radius = reader.number("radius", 0.0, 1e-9, 1e9);
    stroke.strength = reader.number("strength", 1.0, 0.0, 1.0);
    reader.finish();
    parsed.push_back(stroke);
  }
  return parsed;
}

void apply_strokes(const std::vector<Stroke>& strokes, Asset& asset) {
  if (strokes.empty()) return;
  const std::size_t most = std::max(kUsualInfluences, asset.skin.largest_row());
  std::vector<Row> rows;
  for (std::size_t v = 0; v < asset.skin.rows(); ++v)
    rows.emplace_back(asset.skin.row(v), asset.skin.row(v) + asset.skin.row_size(v));
  const bool smooths = std::any_of(strokes.begin(), strokes.end(),
                                   [](const Stroke& stroke) { return stroke.mode == Stroke::Mode::kSmooth; });
  const Places places(smooths ? asset.mesh : Mesh());
  for (const Stroke& stroke : strokes) {
    const auto touched = reached(stroke, asset.mesh);
    std::vector<Row> means;  // before any of them changes
    if (stroke.mode == Stroke::Mode::kSmooth)
      for (const auto& [vertex, amount] : touched) means.push_back(places.mean_around(vertex, rows));
    for (std::size_t i = 0; i < touched.size(); ++i) {
      const auto& [vertex, amount] = touched[i];
      if (stroke.mode == Stroke::Mode::kSmooth) mix(rows[vertex], means[i], amount);
      if (stroke.mode == Stroke::Mode::kAdd) add_weight(rows[vertex], stroke.joint, amount);
      if (stroke.mode == Stroke::Mode::kRemove)
        remove_weight(rows[vertex], stroke.joint, asset.skeleton.parents[at(stroke.joint)], amount);
    }
  }
  SkinWeights skin;
  for (Row& row : rows) skin.append_row(std::move(row));
  asset.skin = limit_influences(skin, most);
}

}  // namespace anigen::studio
