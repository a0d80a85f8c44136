#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/core/random.h"
#include "anigen/rigging/bone_heat.h"
#include "tests/rigging/binding_shapes.h"
#include "tests/support/rig_files.h"

namespace anigen::rigging {
namespace {

using namespace anigen::test;

class Binding : public testing::TestWithParam<SkinBinding> {};
INSTANTIATE_TEST_SUITE_P(Of, Binding, testing::ValuesIn(kAllBindings),
                         [](const auto& info) { return to_string(info.param); });

class SmoothBinding : public testing::TestWithParam<SkinBinding> {};
INSTANTIATE_TEST_SUITE_P(Of, SmoothBinding, testing::Values(SkinBinding::kGeodesicVoxels, SkinBinding::kHeat),
                         [](const auto& info) { return to_string(info.param); });

TEST(SkinBindingWords, GoBothWays) {
  for (const SkinBinding binding : kAllBindings) EXPECT_EQ(parse_skin_binding(to_string(binding)), binding);
  EXPECT_EQ(refusal([] { parse_skin_binding("closest"); }), "--skin: \"closest\" is none of nearest, geovoxel, heat");
}

TEST_P(Binding, GivesSoundRows) {
  for (const Body& body : {two_bones(), two_fingers()}) expect_sound(bound(GetParam(), body), body);
}

TEST_P(Binding, ChangesHandsInTheMiddleBetweenTwoBones) {
  const Body body = two_bones();
  const SkinWeights skin = bound(GetParam(), body);
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    const float x = body.mesh.vertices[v].x(), left = weight_of(skin, v, 0), right = weight_of(skin, v, 1);
    if (std::abs(x) > 0.75F || std::abs(x) < 0.01F) continue;
    EXPECT_GT(x < 0.0F ? left : right, x < 0.0F ? right : left) << "at x = " << x;
  }
}

TEST_P(SmoothBinding, WeightsGoFromOneBoneToTheOtherWithoutJumps) {
  const Body body = two_bones();
  BindingOptions options = coarse(128);
  options.geodesic.falloff = 1.0;
  const SkinWeights skin = bound(GetParam(), body, options);
  float before = 1.0F;
  // One line of vertices along the capsule: 16 sections.
  for (std::size_t v = 1; v + 1 < skin.rows(); v += 16) {
    const float x = body.mesh.vertices[v].x();
    if (std::abs(x) > 0.7F) continue;
    const float left = weight_of(skin, v, 0);
    EXPECT_LE(left, before + 0.02F) << "at x = " << x;
    if (x > -0.65F) {
      EXPECT_GT(left, before - 0.25F) << "at x = " << x;
    }
    if (std::abs(x) < 0.01F) {
      EXPECT_NEAR(left, weight_of(skin, v, 1), 0.02F);
    }
    before = left;
  }
  EXPECT_LT(before, 0.1F);
}

TEST_P(SmoothBinding, MirrorImagesGetMirroredWeights) {
  const Body body = {capsule(1.2, 0.2, 48, 16),
                     skeleton_from_joints({{0, 0, 0}, {-0.9, 0, 0}, {0.9, 0, 0}}, {-1, 0, 0})};
  const SkinWeights skin = bound(GetParam(), body);
  const std::size_t rings = 47, sections = 16;
  for (std::size_t r = 0; r < rings; ++r) {
    for (std::size_t s = 0; s < sections; ++s) {
      const std::size_t v = 1 + r * sections + s, mirrored = 1 + (rings - 1 - r) * sections + s;
      ASSERT_EQ(body.mesh.vertices[v].x(), -body.mesh.vertices[mirrored].x());
      EXPECT_NEAR(weight_of(skin, v, 0), weight_of(skin, mirrored, 0), 1e-4F);
      EXPECT_NEAR(weight_of(skin, v, 1), weight_of(skin, mirrored, 2), 1e-4F);
    }
  }
}

/// The largest weight of the thin finger's bones on the thick finger, beyond where both leave the palm.
float largest_bleeding(const SkinWeights& skin, const Body& body) {
  float largest = 0.0F;
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    const Eigen::Vector3f& p = body.mesh.vertices[v];
    if (p.x() < 1.4F || p.y() > 0.42F) continue;
    largest = std::max(largest, weight_of(skin, v, 3) + weight_of(skin, v, 4));
  }
  return largest;
}

TEST(GeodesicVoxels, KeepFingersApartThatTheNearestBoneMixes) {
  const Body body = two_fingers();
  EXPECT_EQ(largest_bleeding(bound(SkinBinding::kNearest, body), body), 1.0F);
  BindingOptions options = coarse(128);
  EXPECT_LT(largest_bleeding(bound(SkinBinding::kGeodesicVoxels, body, options), body), 0.16F);
  options.geodesic.falloff = 1.0;
  EXPECT_LT(largest_bleeding(bound(SkinBinding::kGeodesicVoxels, body, options), body), 0.04F);
}

TEST(BoneHeat, KeepsFingersApartThatTheNearestBoneMixes) {
  const Body body = two_fingers();
  EXPECT_LT(largest_bleeding(bound(SkinBinding::kHeat, body), body), 0.05F);
}

TEST(BoneHeat, TheBoneBelowTheSurfaceIsNearerThanTheOneBeforeIt) {
  const Body body = two_fingers();
  const WeldedSurface surface = weld_surface(body.mesh);
  const auto sources = heat_sources(surface, surface_parts(surface), moving_bones(body.skeleton, surface));
  std::size_t checked = 0;
  for (std::size_t v = 0; v < body.mesh.vertices.size(); ++v) {
    const Eigen::Vector3f& p = body.mesh.vertices[v];
    // The side of the thick finger that faces the thin one: 0.2 from its own bone, 0.1 from the other's.
    if (std::abs(p.y() - 0.4F) > 1e-6F || p.x() < 1.2F || p.x() > 1.9F || std::abs(p.z() - 0.15F) > 0.06F) continue;
    const HeatSource& source = sources[at(surface.of_vertex[v])];
    EXPECT_EQ(source.joints, std::vector<std::int32_t>{1}) << p.transpose();
    EXPECT_EQ(source.visible, std::vector<bool>{true}) << p.transpose();
    EXPECT_NEAR(source.distance * surface.size, 0.2, 0.01);
    ++checked;
  }
  EXPECT_GT(checked, 5u);
}

std::size_t places_that_see(const Body& body, HeatForm form, float from_x) {
  const WeldedSurface surface = weld_surface(body.mesh);
  const auto sources = heat_sources(surface, surface_parts(surface), moving_bones(body.skeleton, surface), form);
  std::size_t count = 0;
  for (std::size_t p = 0; p < sources.size(); ++p) {
    if (surface.places[p].x() * surface.size + surface.center.x() < from_x) continue;
    count += sources[p].visible == std::vector<bool>(sources[p].visible.size(), true);
  }
  return count;
}

// A box beside a bone, and then a second box between the two, around the bone.
TEST(BoneHeat, BlenderHidesABoneBehindTheFrontsOfFacesAlone) {
  Body body;
  append_box(body.mesh, {2.0, -0.3, -0.3}, {2.5, 0.3, 0.3}, 4);
  body.skeleton = skeleton_from_joints({{0.0, -0.2, 0.0}, {0.0, 0.2, 0.0}}, {-1, 0});
  const std::size_t places = weld_surface(body.mesh).places.size();
  EXPECT_EQ(places_that_see(body, HeatForm::kBlender, 1.9F), places) << "a way out of a body is free";
  EXPECT_LT(places_that_see(body, HeatForm::kPublished, 1.9F), places);
  append_box(body.mesh, {-0.5, -0.5, -0.5}, {0.5, 0.5, 0.5}, 4);
  EXPECT_EQ(places_that_see(body, HeatForm::kBlender, 1.9F), 0u) << "a way into a body is not";
  EXPECT_GT(places_that_see(body, HeatForm::kBlender, -1.0F), 50u) << "the box around the bone sees it";
}

TEST(BoneHeat, FittedHeatDoesNotDependOnTheWindingOfABody) {
  Body body = two_fingers();
  const SkinWeights outward = bind_by_heat(body.mesh, body.skeleton, fitted_heat(4));
  for (Triangle& face : body.mesh.faces) std::swap(face[1], face[2]);
  const SkinWeights inward = bind_by_heat(body.mesh, body.skeleton, fitted_heat(4));
  for (std::size_t v = 0; v < outward.rows(); ++v) {
    for (int joint = 0; joint < 5; ++joint)
      EXPECT_NEAR(weight_of(inward, v, joint), weight_of(outward, v, joint), 1e-4) << v;
  }
}

TEST(BoneHeat, FittedHeatKeepsFingersApart) {
  const Body body = two_fingers();
  const SkinWeights weights = bind_by_heat(body.mesh, body.skeleton, fitted_heat(2));
  EXPECT_LT(largest_bleeding(weights, body), 0.05F);
  EXPECT_LE(weights.largest_row(), 2u);
}

TEST(MovingBones, JoinedLinesEndInTheMiddleOfTheChildren) {
  const Body body = two_fingers();
  const WeldedSurface surface = weld_surface(body.mesh);
  std::vector<MovingBones> bones = moving_bones(body.skeleton, surface);
  ASSERT_EQ(bones[0].lines.size(), 2u);
  join_lines(bones);
  ASSERT_EQ(bones[0].lines.size(), 1u);
  EXPECT_LT((bones[0].lines[0].end - surface.to_unit({1.0, 0.35, 0.15})).norm(), 1e-6);
  EXPECT_EQ(bones[1].lines.size(), 1u);
}

TEST(GeodesicVoxels, AHigherFalloffIsSharper) {
  const Body body = two_bones();
  double before = 0.0;
  for (const double falloff : {0.0, 0.2, 0.6, 1.0}) {
    BindingOptions options = coarse();
    options.geodesic.falloff = falloff;
    const SkinWeights skin = bound(SkinBinding::kGeodesicVoxels, body, options);
    double heaviest = 0.0;
    for (std::size_t v = 0; v < skin.rows(); ++v) heaviest += static_cast<double>(skin.row(v)[0].weight);
    EXPECT_GT(heaviest, before);
    before = heaviest;
  }
}

TEST(GeodesicVoxels, WeightsFollowTheLaw) {
  // A thin straight rod with a bone in each half, seen where paths run along the grid: distances are known.
  Body body;
  append_box(body.mesh, {-1.0, -0.02, -0.02}, {1.0, 0.02, 0.02}, 20);
  body.skeleton = skeleton_from_joints({{-1.0, 0, 0}, {-0.5, 0, 0}, {0.5, 0, 0}, {1.0, 0, 0}}, {-1, 0, 1, 2});
  BindingOptions options = coarse(128);
  options.geodesic.most_influences = 0;
  for (const double falloff : {0.0, 0.2, 1.0}) {
    options.geodesic.falloff = falloff;
    const SkinWeights skin = bound(SkinBinding::kGeodesicVoxels, body, options);
    const auto law = [&](double along) {
      const double d = along / 2.0;
      return std::pow(1.0 / ((1.0 - falloff) * d + falloff * d * d), 2.0);
    };
    for (std::size_t v = 0; v < skin.rows(); ++v) {
      const Eigen::Vector3f& p = body.mesh.vertices[v];
      if (std::abs(p.x() - 0.1F) > 1e-3F) continue;
      // Joint 0 ends at −0.5, joint 2 begins at 0.5.
      const double expected = law(0.6) / law(0.4);
      EXPECT_NEAR(weight_of(skin, v, 0) / weight_of(skin, v, 2), expected, 0.1 * expected);
    }
  }
}

TEST_P(SmoothBinding, KeepsAsManyInfluencesAsAsked) {
  const Body body = two_fingers();
  BindingOptions options = coarse();
  options.geodesic.most_influences = options.heat.most_influences = 0;
  const SkinWeights all = bound(GetParam(), body, options);
  expect_sound(all, body, body.skeleton.size());
  for (const std::size_t most : {std::size_t{1}, std::size_t{2}, std::size_t{3}}) {
    options.geodesic.most_influences = options.heat.most_influences = most;
    const SkinWeights some = bound(GetParam(), body, options);
    expect_sound(some, body, most);
    // For geodesic voxels fewer influences also mean shorter paths, which must not show.
    EXPECT_LT(largest_difference(some, limit_influences(all, most), body.skeleton.size()), 1e-6F);
  }
}

TEST_P(Binding, HasTheSameBitsForAnyNumberOfThreads) {
  for (const Body& body : {two_bones(), two_fingers()}) {
    set_thread_count(1);
    const SkinWeights one = bound(GetParam(), body);
    for (const int threads : {2, 5}) {
      set_thread_count(threads);
      EXPECT_EQ(differing_rows(bound(GetParam(), body), one), 0u);
    }
    set_thread_count(0);
  }
}

TEST_P(Binding, DoesNotDependOnTheOrderOfVerticesAndFaces) {
  const Body body = two_fingers();
  const SkinWeights skin = bound(GetParam(), body);
  const std::vector<std::size_t> order = Rng(1, "binding order").permutation(body.mesh.vertices.size());
  Body shuffled{{}, body.skeleton};
  std::vector<std::int32_t> moved_to(order.size());
  for (std::size_t v = 0; v < order.size(); ++v) {
    shuffled.mesh.vertices.push_back(body.mesh.vertices[order[v]]);
    moved_to[order[v]] = static_cast<std::int32_t>(v);
  }
  for (auto face = body.mesh.faces.rbegin(); face != body.mesh.faces.rend(); ++face) {
    shuffled.mesh.faces.push_back({moved_to[at((*face)[1])], moved_to[at((*face)[2])], moved_to[at((*face)[0])]});
  }
  const SkinWeights other = bound(GetParam(), shuffled);
  for (std::size_t v = 0; v < order.size(); ++v) ASSERT_TRUE(same_row(other, v, skin, order[v])) << "vertex " << v;
}

TEST_P(Binding, SeamsDoNotShow) {
  const Body whole = two_bones();
  const SkinWeights skin = bound(GetParam(), whole);
  Body split{{}, whole.skeleton};  // every face with vertices of its own
  for (const Triangle& face : whole.mesh.faces) {
    const auto first = static_cast<std::int32_t>(split.mesh.vertices.size());
    for (const std::int32_t v : face) split.mesh.vertices.push_back(whole.mesh.vertices[at(v)]);
    split.mesh.faces.push_back({first, first + 1, first + 2});
  }
  const SkinWeights other = bound(GetParam(), split);
  for (std::size_t f = 0; f < whole.mesh.faces.size(); ++f) {
    for (std::size_t k = 0; k < 3; ++k)
      ASSERT_TRUE(same_row(other, 3 * f + k, skin, at(whole.mesh.faces[f][k]))) << "face " << f;
  }
}

Body transformed(const Body& body, double scale, const Eigen::Vector3d& offset) {
  Body result{body.mesh, {}};
  for (Eigen::Vector3f& p : result.mesh.vertices) p = (scale * p.cast<double>() + offset).cast<float>();
  std::vector<Eigen::Vector3d> joints;
  for (const Eigen::Vector3d& joint : body.skeleton.positions()) joints.push_back(scale * joint + offset);
  result.skeleton = skeleton_from_joints(joints, body.skeleton.parents);
  return result;
}

TEST_P(Binding, DoesNotDependOnTheUnit) {
  const Body body = two_bones();
  const SkinWeights skin = bound(GetParam(), body);
  // Powers of two change no digit.
  for (const double scale : {1024.0, 0x1p-60, 0x1p60})
    EXPECT_EQ(differing_rows(bound(GetParam(), transformed(body, scale, Eigen::Vector3d::Zero())), skin), 0u);
  if (GetParam() == SkinBinding::kNearest) return;  // whole vertices change hands by rounding
  EXPECT_LT(largest_difference(bound(GetParam(), transformed(body, 3.7, {0.3, -1.0, 2.0})), skin, 3), 0.02F);
}

}  // namespace
}  // namespace anigen::rigging
