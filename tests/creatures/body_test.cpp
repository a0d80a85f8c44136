#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <map>
#include <numeric>
#include <set>

#include "anigen/asset/animation.h"
#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/creatures/body.h"

namespace anigen::creatures {
namespace {

constexpr std::uint64_t kSeed = 20;
constexpr std::size_t kCount = 12;

/// Number of directed edges that do not have exactly one partner in the other direction: 0 for a closed, consistently
/// oriented surface whose edges all have two faces.
std::size_t unmatched_edges(const std::vector<Triangle>& faces) {
  const auto key = [](int a, int b) { return static_cast<std::uint64_t>(a) << 32 | static_cast<std::uint32_t>(b); };
  std::vector<std::uint64_t> edges, reversed;
  for (const Triangle& t : faces) {
    for (int k = 0; k < 3; ++k) {
      edges.push_back(key(t[k], t[(k + 1) % 3]));
      reversed.push_back(key(t[(k + 1) % 3], t[k]));
    }
  }
  std::sort(edges.begin(), edges.end());
  std::sort(reversed.begin(), reversed.end());
  std::size_t wrong = 0;
  for (std::size_t e = 0; e < edges.size(); ++e)
    wrong += edges[e] != reversed[e] || (e > 0 && edges[e] == edges[e - 1]);
  return wrong;
}

/// Number of vertices whose faces do not form one closed fan.
std::size_t pinched_vertices(const Mesh& mesh) {
  std::vector<std::vector<std::pair<int, int>>> next(mesh.vertices.size());
  for (const Triangle& t : mesh.faces) {
    for (int k = 0; k < 3; ++k) next[t[k]].emplace_back(t[(k + 1) % 3], t[(k + 2) % 3]);
  }
  std::size_t wrong = 0;
  for (const auto& fan : next) {
    if (fan.empty()) {
      ++wrong;
      continue;
    }
    std::size_t steps = 0;
    int at = fan.front().first;
    do {
      const auto step = std::find_if(fan.begin(), fan.end(), [at](const auto& e) { return e.first == at; });
      if (step == fan.end()) break;
      at = step->second;
      ++steps;
    } while (at != fan.front().first && steps <= fan.size());
    wrong += steps != fan.size();
  }
  return wrong;
}

std::size_t components(const Mesh& mesh) {
  std::vector<int> root(mesh.vertices.size());
  std::iota(root.begin(), root.end(), 0);
  const std::function<int(int)> find = [&](int v) {
    while (root[v] != v) v = root[v] = root[root[v]];
    return v;
  };
  for (const Triangle& t : mesh.faces) {
    root[find(t[1])] = find(t[0]);
    root[find(t[2])] = find(t[0]);
  }
  std::set<int> roots;
  for (std::size_t v = 0; v < root.size(); ++v) roots.insert(find(static_cast<int>(v)));
  return roots.size();
}

double volume(const Mesh& mesh) {
  double sum = 0.0;
  for (const Triangle& t : mesh.faces) {
    const Eigen::Vector3d a = mesh.vertices[t[0]].cast<double>(), b = mesh.vertices[t[1]].cast<double>(),
                          c = mesh.vertices[t[2]].cast<double>();
    sum += a.dot(b.cross(c)) / 6.0;
  }
  return sum;
}

int tree_distance(const std::vector<int>& parents, int a, int b) {
  std::map<int, int> above;
  for (int hops = 0; a >= 0; a = parents[a]) above[a] = hops++;
  for (int hops = 0; b >= 0; b = parents[b], ++hops) {
    if (above.count(b) > 0) return above[b] + hops;
  }
  return 1000;
}

bool same_bytes(const Asset& a, const Asset& b) {
  const auto equal = [](const auto& x, const auto& y) {
    return x.size() == y.size() && std::memcmp(x.data(), y.data(), x.size() * sizeof(x[0])) == 0;
  };
  if (!equal(a.mesh.vertices, b.mesh.vertices) || !equal(a.mesh.faces, b.mesh.faces) ||
      !equal(a.mesh.normals, b.mesh.normals) || !equal(a.mesh.colors, b.mesh.colors) ||
      !equal(a.skin.offsets, b.skin.offsets) || !equal(a.skin.influences, b.skin.influences) ||
      a.skeleton.names != b.skeleton.names || a.skeleton.parents != b.skeleton.parents ||
      !equal(a.skeleton.bind, b.skeleton.bind) || a.animations.size() != b.animations.size()) {
    return false;
  }
  for (std::size_t n = 0; n < a.animations.size(); ++n) {
    if (a.animations[n].channels.size() != b.animations[n].channels.size()) return false;
    for (std::size_t c = 0; c < a.animations[n].channels.size(); ++c) {
      if (!equal(a.animations[n].channels[c].values, b.animations[n].channels[c].values)) return false;
    }
  }
  return true;
}

void check_mesh(const Asset& asset) {
  const Mesh& mesh = asset.mesh;
  EXPECT_GE(mesh.vertices.size(), 2000u);
  EXPECT_LE(mesh.vertices.size(), 8000u);
  EXPECT_EQ(unmatched_edges(mesh.faces), 0u);
  EXPECT_EQ(pinched_vertices(mesh), 0u);
  EXPECT_EQ(components(mesh), 1u);
  EXPECT_GT(volume(mesh), 1e-4) << "inside out or without a volume";
  const Box box = bounding_box(mesh.vertices);
  // Single precision positions around the unit box.
  EXPECT_NEAR(box.longest_side(), 1.0, 1e-5);
  EXPECT_NEAR(box.center().norm(), 0.0, 1e-5);
  ASSERT_EQ(mesh.normals.size(), mesh.vertices.size());
  ASSERT_EQ(mesh.colors.size(), mesh.vertices.size());
  // Normals point outwards: nearly everywhere they agree with the faces'.
  const auto faces = vertex_normals(mesh.vertices, mesh.faces);
  std::size_t against = 0;
  for (std::size_t v = 0; v < faces.size(); ++v) against += faces[v].dot(mesh.normals[v]) < 0.5f;
  EXPECT_EQ(against, 0u);
}

void check_skin(const Asset& asset) {
  ASSERT_EQ(asset.skin.rows(), asset.mesh.vertices.size());
  EXPECT_LE(asset.skin.largest_row(), 8u);
  const std::size_t joints = asset.skeleton.size();
  std::vector<int> hops(joints * joints, -1);
  std::set<int> used;
  int farthest = 0;
  for (std::size_t v = 0; v < asset.skin.rows(); ++v) {
    const Influence* row = asset.skin.row(v);
    double sum = 0.0;
    for (std::size_t k = 0; k < asset.skin.row_size(v); ++k) {
      sum += row[k].weight;
      int& known = hops[row[0].joint * joints + row[k].joint];
      if (known < 0) {
        used.insert(row[k].joint);
        known = tree_distance(asset.skeleton.parents, row[0].joint, row[k].joint);
        farthest = std::max(farthest, known);
      }
    }
    ASSERT_NEAR(sum, 1.0, 1e-5) << "vertex " << v;
  }
  // Weights follow the tree: at most three hops along a limb, and one more for a twist helper on either side.
  EXPECT_LE(farthest, 5);
  EXPECT_GE(used.size(), std::min<std::size_t>(4, joints - 1));
}

/// A vertex on one side of the body is never moved by the other one.
void check_sides(const Asset& asset) {
  const auto side = [&](int joint) {
    const std::string& name = asset.skeleton.names[joint];
    return name.find("left") != std::string::npos ? 1 : name.find("right") != std::string::npos ? -1 : 0;
  };
  for (std::size_t v = 0; v < asset.skin.rows(); ++v) {
    const int heaviest = side(asset.skin.row(v)[0].joint);
    for (std::size_t k = 1; k < asset.skin.row_size(v); ++k)
      ASSERT_NE(side(asset.skin.row(v)[k].joint) * heaviest, -1) << "vertex " << v;
  }
}

void check_animation(const Asset& asset) {
  ASSERT_EQ(asset.animations.size(), 1u);
  const Animation& animation = asset.animations[0];
  EXPECT_GE(animation.duration(), 1.0);
  EXPECT_LE(animation.duration(), 2.0);
  double moved = 0.0;
  for (double t : {0.0, 0.25, 0.5, 0.75}) {
    const auto posed = skin_vertices(asset, sample(animation, asset.skeleton, t * animation.duration()));
    for (std::size_t v = 0; v < posed.size(); ++v) {
      ASSERT_TRUE(posed[v].allFinite());
      moved = std::max(moved, static_cast<double>((posed[v] - asset.mesh.vertices[v]).norm()));
    }
  }
  EXPECT_GT(moved, 0.005);
  EXPECT_LT(moved, 1.0) << "an idle animation, not an explosion";
  const auto first = sample(animation, asset.skeleton, 0.0),
             last = sample(animation, asset.skeleton, animation.duration());
  for (std::size_t j = 0; j < first.size(); ++j)
    EXPECT_NEAR(first[j].rotation.angularDistance(last[j].rotation), 0.0, 1e-6) << "does not loop";
}

class CreatureFamily : public testing::TestWithParam<std::string> {};

TEST_P(CreatureFamily, AssetsAreSound) {
  std::vector<Asset> assets(kCount);
  parallel_for(kCount, [&](std::size_t i) { assets[i] = make_creature(GetParam(), kSeed, i); });
  for (std::size_t i = 0; i < kCount; ++i) {
    SCOPED_TRACE(GetParam() + " " + std::to_string(i));
    const Asset& asset = assets[i];
    EXPECT_EQ(validate(asset), std::vector<std::string>{});
    check_mesh(asset);
    EXPECT_GE(asset.skeleton.size(), 4u);
    EXPECT_LE(asset.skeleton.size(), 60u);
    const std::set<std::string> names(asset.skeleton.names.begin(), asset.skeleton.names.end());
    EXPECT_EQ(names.size(), asset.skeleton.size());
    check_skin(asset);
    check_sides(asset);
    check_animation(asset);
    if (i > 0) {
      EXPECT_FALSE(same_bytes(asset, assets[i - 1]));
    }
  }
  // The second call runs alone, the first one ran beside others.
  EXPECT_TRUE(same_bytes(assets[3], make_creature(GetParam(), kSeed, 3)));
  EXPECT_FALSE(same_bytes(assets[3], make_creature(GetParam(), kSeed + 1, 3)));
}

INSTANTIATE_TEST_SUITE_P(All, CreatureFamily, testing::ValuesIn(creature_families()),
                         [](const auto& info) { return info.param; });

TEST(Creatures, AllFamiliesAppearInTheStream) {
  EXPECT_GE(creature_families().size(), 10u);
  std::map<std::string, int> seen;
  for (std::uint64_t i = 0; i < 1000; ++i) ++seen[creature_family(kSeed, i)];
  // Uniform: each expects 1000 / 15 = 67 with a standard deviation of 8; five of them on either side.
  for (const std::string& family : creature_families()) {
    EXPECT_GT(seen[family], 27) << family;
    EXPECT_LT(seen[family], 107) << family;
  }
  const Asset drawn = make_creature(kSeed, 5);
  EXPECT_TRUE(same_bytes(drawn, make_creature(creature_family(kSeed, 5), kSeed, 5)));
}

TEST(Creatures, WeightsLookLikeThoseOfRealRigs) {
  // Real rigs have about half of their vertices on a single joint; the mixture must hold rigid and soft assets.
  const std::size_t count = 60;
  std::vector<double> single(count);
  parallel_for(count, [&](std::size_t i) {
    const SkinWeights skin = make_creature(kSeed, i).skin;
    for (std::size_t v = 0; v < skin.rows(); ++v) single[i] += skin.row_size(v) == 1 ? 1.0 / skin.rows() : 0.0;
  });
  const double mean = std::accumulate(single.begin(), single.end(), 0.0) / static_cast<double>(count);
  EXPECT_GT(mean, 0.4);
  EXPECT_LT(mean, 0.7);
  EXPECT_LT(*std::min_element(single.begin(), single.end()), 0.25);
  EXPECT_GT(*std::max_element(single.begin(), single.end()), 0.9);
}

TEST(Creatures, UnknownFamilyIsAnInputErrorThatNamesTheKnownOnes) {
  try {
    make_creature("unicorn", 0, 0);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("unicorn"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("quadruped"), std::string::npos);
  }
}

}  // namespace
}  // namespace anigen::creatures
