#include <gtest/gtest.h>
#include <cmath>
#include <limits>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/core/random.h"
#include "anigen/rigging/pinocchio.h"
#include "anigen/rigging/pinocchio_template.h"
#include "anigen/rigging/species_templates.h"
#include "tests/rigging/embedding_bodies.h"

namespace anigen::rigging {

namespace {

using test::animal;
using test::capsule_mesh;
using test::person;
using Points = std::vector<Eigen::Vector3d>;

std::size_t joint_named(const Skeleton& skeleton, const std::string& name) {
  const auto found = std::find(skeleton.names.begin(), skeleton.names.end(), name);
  EXPECT_NE(found, skeleton.names.end()) << name;
  return static_cast<std::size_t>(found - skeleton.names.begin());
}

void expect_places(const Skeleton& skeleton, const std::map<std::string, Eigen::Vector3d>& places, double tolerance) {
  const Points joints = skeleton.positions();
  for (const auto& [name, place] : places) {
    const Eigen::Vector3d joint = joints[joint_named(skeleton, name)];
    EXPECT_LT((joint - place).norm(), tolerance) << name << " at " << joint.transpose();
    if (name.rfind("left_", 0) != 0) continue;
    const Eigen::Vector3d other = joints[joint_named(skeleton, "right_" + name.substr(5))];
    EXPECT_LT((other - Eigen::Vector3d(-place.x(), place.y(), place.z())).norm(), tolerance) << "right of " << name;
  }
}

/// Enough cells for bodies of capsules, and an eighth of the default's time.
EmbeddingOptions coarse() {
  EmbeddingOptions options;
  options.resolution = 64;
  return options;
}

double largest_move(const Skeleton& a, const Skeleton& b) {
  const Points from = a.positions(), to = b.positions();
  EXPECT_EQ(from.size(), to.size());
  double most = 0.0;
  for (std::size_t j = 0; j < from.size(); ++j) most = std::max(most, (from[j] - to[j]).norm());
  return most;
}

void expect_sound(const Skeleton& skeleton, const Mesh& mesh) {
  Asset asset;
  asset.mesh = mesh;
  asset.skeleton = skeleton;
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) asset.skin.append_row({{0, 1.0F}});
  EXPECT_EQ(validate(asset), std::vector<std::string>{});
}

TEST(EmbedSkeleton, JointsOfAPerson) {
  const Mesh mesh = capsule_mesh(person());
  const EmbeddedSkeleton embedded = embed_skeleton(mesh, biped_template());
  EXPECT_TRUE(embedded.best);
  EXPECT_LT(embedded.penalty, 0.2);
  EXPECT_LE(embedded.energy, embedded.energy_before);
  EXPECT_EQ(embedded.skeleton.size(), 19u);
  EXPECT_EQ(embedded.skeleton.names[0], "hips");
  expect_places(embedded.skeleton, test::person_joints(), 0.05);
  expect_sound(embedded.skeleton, mesh);
}

TEST(EmbedSkeleton, JointsOfAnAnimal) {
  const EmbeddedSkeleton embedded = embed_skeleton(capsule_mesh(animal()), quadruped_template());
  EXPECT_LT(embedded.penalty, 0.3);
  EXPECT_EQ(embedded.skeleton.size(), 24u);
  expect_places(embedded.skeleton, test::animal_joints(), 0.06);
}

TEST(EmbedSkeleton, SidesAreMirrored) {
  const Skeleton skeleton = embed_skeleton(capsule_mesh(person()), biped_template()).skeleton;
  const Points joints = skeleton.positions();
  for (std::size_t j = 0; j < joints.size(); ++j) {
    std::string name = skeleton.names[j];
    if (name.rfind("left_", 0) == 0) {
      name = "right_" + name.substr(5);
    } else if (name.rfind("right_", 0) == 0) {
      name = "left_" + name.substr(6);
    }
    const Eigen::Vector3d other = joints[joint_named(skeleton, name)];
    EXPECT_LT((Eigen::Vector3d(-other.x(), other.y(), other.z()) - joints[j]).norm(), 0.03) << skeleton.names[j];
  }
}

TEST(EmbedSkeleton, TrianglesDoNotMatter) {
  const Skeleton plain = embed_skeleton(capsule_mesh(person()), biped_template()).skeleton;
  EXPECT_LT(largest_move(plain, embed_skeleton(capsule_mesh(person(), 40, 12), biped_template()).skeleton), 0.03);

  // One surface: faces turned over, corners not shared, a vertex that no face uses.
  Mesh apart;
  const Mesh mesh = capsule_mesh(person());
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    const auto first = static_cast<std::int32_t>(apart.vertices.size());
    for (const std::int32_t v : mesh.faces[f]) apart.vertices.push_back(mesh.vertices[static_cast<std::size_t>(v)]);
    apart.faces.push_back(f % 2 == 0 ? Triangle{first, first + 1, first + 2} : Triangle{first + 2, first + 1, first});
  }
  apart.vertices.emplace_back(std::numeric_limits<float>::quiet_NaN(), 0.0F, 0.0F);
  EXPECT_LT(largest_move(plain, embed_skeleton(apart, biped_template()).skeleton), 0.03);
}

TEST(EmbedSkeleton, HolesDoNotMatter) {
  const Mesh mesh = capsule_mesh(person());
  Mesh torn = mesh;
  torn.faces.clear();
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    if (f % 40 != 0) torn.faces.push_back(mesh.faces[f]);
  }
  const EmbeddedSkeleton embedded = embed_skeleton(torn, biped_template());
  expect_places(embedded.skeleton, test::person_joints(), 0.06);
}

TEST(EmbedSkeleton, FollowsTheMeshsUnit) {
  const Mesh mesh = capsule_mesh(person());
  const Skeleton plain = embed_skeleton(mesh, biped_template(), coarse()).skeleton;
  for (const double scale : {1e-12, 180.0, 1e12}) {
    Mesh scaled = mesh;
    for (Eigen::Vector3f& v : scaled.vertices)
      v = (scale * (v.cast<double>() + Eigen::Vector3d(1.0, -2.0, 0.5))).cast<float>();
    Points back;
    const EmbeddedSkeleton embedded = embed_skeleton(scaled, biped_template(), coarse());
    for (const Eigen::Vector3d& joint : embedded.skeleton.positions())
      back.emplace_back(joint / scale - Eigen::Vector3d(1.0, -2.0, 0.5));
    EXPECT_LT(largest_move(plain, skeleton_from_joints(back, plain.parents)), 0.02) << scale;
  }
}

TEST(EmbedSkeleton, ThreadsDoNotMatter) {
  const Mesh mesh = capsule_mesh(animal());
  const int threads = thread_count();
  set_thread_count(1);
  const EmbeddedSkeleton one = embed_skeleton(mesh, quadruped_template(), coarse());
  set_thread_count(4);
  const EmbeddedSkeleton four = embed_skeleton(mesh, quadruped_template(), coarse());
  set_thread_count(threads);
  EXPECT_EQ(largest_move(one.skeleton, four.skeleton), 0.0);
  EXPECT_EQ(one.penalty, four.penalty);
}

TEST(EmbedSkeleton, TheRightTemplateCostsLess) {
  const std::vector<TemplateSkeleton> templates{biped_template(), quadruped_template()};
  const TemplateChoice two_legs = choose_template(capsule_mesh(person()), templates);
  EXPECT_EQ(two_legs.index, 0u);
  EXPECT_LT(two_legs.penalties[0] + 0.1, two_legs.penalties[1]);
  EXPECT_EQ(two_legs.embedded.penalty, two_legs.penalties[0]);
  const TemplateChoice four_legs = choose_template(capsule_mesh(animal()), templates);
  EXPECT_EQ(four_legs.index, 1u);
  EXPECT_LT(four_legs.penalties[1] + 0.1, four_legs.penalties[0]);
  EXPECT_THROW(choose_template(capsule_mesh(person()), {}), InputError);
}

// Templates that cannot win are given up, whoever is ahead and whenever.
TEST(EmbedSkeleton, AChoiceIsThatOfEmbeddingEachByItself) {
  const std::vector<TemplateSkeleton> templates{biped_template(), quadruped_template()};
  const int threads = thread_count();
  for (const bool upright : {true, false}) {
    const Mesh mesh = capsule_mesh(upright ? person() : animal());
    const EmbeddedSkeleton alone = embed_skeleton(mesh, templates[upright ? 0 : 1], coarse());
    for (const int used : {1, 2}) {
      set_thread_count(used);
      const TemplateChoice choice = choose_template(mesh, templates, coarse());
      EXPECT_EQ(choice.index, upright ? 0U : 1U);
      EXPECT_EQ(choice.embedded.penalty, alone.penalty);
      EXPECT_EQ(largest_move(choice.embedded.skeleton, alone.skeleton), 0.0);
    }
    set_thread_count(threads);
  }
}

TEST(EmbedSkeleton, AnswersWhenTheSearchIsCutShort) {
  EmbeddingOptions options;
  options.most_states = 1;
  options.most_stretch = 1.0;
  const EmbeddedSkeleton embedded = embed_skeleton(capsule_mesh(person()), biped_template(), options);
  EXPECT_FALSE(embedded.best);
  EXPECT_LE(embedded.states, 1 + options.beam_width * 8);
  expect_places(embedded.skeleton, test::person_joints(), 0.08);
}

TEST(EmbedSkeleton, GuidesAreKeptOnRequest) {
  EmbeddingOptions options;
  options.keep_guides = true;
  const Skeleton skeleton = embed_skeleton(capsule_mesh(person()), biped_template(), options).skeleton;
  EXPECT_EQ(skeleton.size(), 24u);
  EXPECT_GT(skeleton.positions()[joint_named(skeleton, "left_hand_tip")].x(), 0.43);
}

TEST(EmbedSkeleton, PiecesThatDoNotTouchAreBridged) {
  // The arms float beside the body.
  std::vector<test::Capsule> body = person();
  for (test::Capsule& capsule : body) {
    if (std::abs(capsule.b.x()) < 0.2) continue;
    for (Eigen::Vector3d* end : {&capsule.a, &capsule.b}) {
      if (std::abs(end->x()) < 0.2) end->x() = end->x() < 0.0 || capsule.b.x() < 0.0 ? -0.17 : 0.17;
    }
  }
  const EmbeddedSkeleton embedded = embed_skeleton(capsule_mesh(body), biped_template());
  EXPECT_EQ(embedded.bridges, 2);
  EXPECT_LT(
      (embedded.skeleton.positions()[joint_named(embedded.skeleton, "left_hand")] - test::person_joints()["left_hand"])
          .norm(),
      0.06);
}

Mesh drawn_soup(std::size_t faces) {
  Rng rng(5, "soup");
  Mesh mesh;
  for (std::size_t f = 0; f < faces; ++f) {
    const auto first = static_cast<std::int32_t>(mesh.vertices.size());
    for (int k = 0; k < 3; ++k) {
      mesh.vertices.emplace_back(static_cast<float>(rng.uniform()), static_cast<float>(rng.uniform()),
                                 static_cast<float>(rng.uniform()));
    }
    mesh.faces.push_back({first, first + 1, first + 2});
  }
  return mesh;
}

TEST(EmbedSkeleton, AnyMeshWithExtentGivesASoundSkeleton) {
  Mesh triangle;
  triangle.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 0, 1}};
  triangle.faces = {{0, 1, 2}};
  Mesh line = triangle;
  line.vertices[2] = {0.5F, 0, 0};
  Mesh repeated = triangle;
  repeated.faces = {{0, 1, 1}};
  Mesh huge = capsule_mesh(person());
  for (Eigen::Vector3f& v : huge.vertices) v *= 3e37F;
  Mesh tiny = capsule_mesh(person());
  for (Eigen::Vector3f& v : tiny.vertices) v *= 1e-37F;
  const Mesh far_apart = capsule_mesh({{{0, 0, 0}, {0, 0, 0}, 1e-3}, {{1, 0, 0}, {1, 0, 0}, 1e-3}});
  for (const Mesh& mesh : {triangle, line, repeated, huge, tiny, far_apart, drawn_soup(200),
                           capsule_mesh({{{0, 0, 0}, {0, 0, 0}, 0.5}})}) {
    const EmbeddedSkeleton embedded = embed_skeleton(mesh, biped_template(), coarse());
    const Box box = bounding_box(mesh.vertices);
    for (const Eigen::Vector3d& joint : embedded.skeleton.positions()) {
      ASSERT_TRUE(joint.allFinite());
      EXPECT_LT(((joint - box.center()) / box.longest_side()).cwiseAbs().maxCoeff(), 1.0);
    }
    EXPECT_TRUE(std::isfinite(embedded.penalty));
  }
}

TEST(EmbedSkeleton, RefusesWhatIsNoMesh) {
  const Mesh good = capsule_mesh(person());
  Mesh bad;
  EXPECT_THROW(embed_skeleton(bad, biped_template()), InputError);
  bad.vertices = good.vertices;
  EXPECT_THROW(embed_skeleton(bad, biped_template()), InputError);
  bad = good;
  bad.faces[7][1] = 1 << 30;
  EXPECT_THROW(embed_skeleton(bad, biped_template()), InputError);
  bad = good;
  bad.vertices[7].x() = std::numeric_limits<float>::infinity();
  EXPECT_THROW(embed_skeleton(bad, biped_template()), InputError);
  bad = good;
  for (Eigen::Vector3f& v : bad.vertices) v = {1.0F, 2.0F, 3.0F};
  EXPECT_THROW(embed_skeleton(bad, biped_template()), InputError);
  EmbeddingOptions options;
  options.resolution = 1 << 20;
  EXPECT_THROW(embed_skeleton(good, biped_template(), options), InputError);
}

}  // namespace

namespace {

const TemplateJoint& template_joint(const TemplateSkeleton& skeleton, const std::string& name) {
  for (const TemplateJoint& joint : skeleton.joints) {
    if (joint.name == name) return joint;
  }
  throw InputError("", name, "is not there");
}

TEST(EmbeddingTemplate, PublishedOnesAreSoundAndMirrored) {
  for (const TemplateSkeleton& skeleton : {biped_template(), quadruped_template()}) {
    EXPECT_NO_THROW(check(skeleton));
    for (std::size_t j = 0; j < skeleton.joints.size(); ++j) {
      const TemplateJoint& joint = skeleton.joints[j];
      EXPECT_EQ(joint.mirror < 0, joint.position.x() == 0.0) << joint.name;
      if (joint.mirror < 0) continue;
      const TemplateJoint& other = skeleton.joints[static_cast<std::size_t>(joint.mirror)];
      EXPECT_EQ(other.mirror, static_cast<int>(j));
      EXPECT_EQ(other.position.x(), -joint.position.x());
      EXPECT_EQ(joint.name.rfind("left_", 0) == 0, joint.position.x() > 0.0);
    }
  }
}

TEST(EmbeddingTemplate, ReducesToBranchesAndTips) {
  const ReducedSkeleton reduced = reduced_skeleton(biped_template(), 0.5);
  ASSERT_EQ(reduced.joints.size(), 7u);
  int tips = 0, feet = 0;
  for (const ReducedJoint& joint : reduced.joints) {
    tips += joint.leaf ? 1 : 0;
    feet += joint.foot ? 1 : 0;
    if (joint.parent < 0) continue;
    EXPECT_DOUBLE_EQ(joint.fractions.back(), 1.0);
    EXPECT_TRUE(std::is_sorted(joint.fractions.begin(), joint.fractions.end()));
    EXPECT_EQ(joint.chain.back(), joint.joint);
  }
  EXPECT_EQ(tips, 5);
  EXPECT_EQ(feet, 2);
  EXPECT_EQ(reduced_skeleton(quadruped_template(), 0.5).joints.size(), 8u);
}

/// The biped with a root on the ground, three fingers on each hand and an eye.
Skeleton detailed_rig() {
  std::vector<Eigen::Vector3d> joints{{0, 0, -0.5}};
  std::vector<int> parents{-1};
  std::vector<std::string> names{"ground"};
  for (const TemplateJoint& joint : biped_template().joints) {
    joints.push_back(joint.position);
    parents.push_back(joint.parent + 1);
    names.push_back(joint.name);
  }
  const auto add = [&](const std::string& name, const std::string& parent, const Eigen::Vector3d& offset) {
    const auto at = static_cast<std::size_t>(std::find(names.begin(), names.end(), parent) - names.begin());
    joints.emplace_back(joints[at] + offset);
    parents.push_back(static_cast<int>(at));
    names.push_back(name);
  };
  for (const std::string side : {"left", "right"}) {
    const double x = side == "left" ? 1.0 : -1.0;
    add("thumb." + side, side + "_hand", {0.02 * x, -0.02, 0});
    add("thumb_end." + side, "thumb." + side, {0.02 * x, -0.02, 0});
    add("finger." + side, side + "_hand", {0.03 * x, 0.02, 0});
  }
  add("eye", "head", {0, -0.05, 0.02});
  return skeleton_from_joints(joints, parents, names);
}

TEST(EmbeddingTemplate, FromARigWithFingers) {
  Box box;
  box.low.setConstant(-0.5);
  box.high.setConstant(0.5);
  const TemplateSkeleton made = template_from_skeleton(detailed_rig(), box);
  for (const char* name : {"ground", "thumb.left", "thumb_end.right", "finger.left", "eye"})
    EXPECT_TRUE(template_joint(made, name).carried) << name;
  for (const char* name : {"hips", "chest", "left_hand", "left_hand_tip", "right_toes_tip"})
    EXPECT_FALSE(template_joint(made, name).carried) << name;
  EXPECT_TRUE(template_joint(made, "left_toes_tip").foot);
  EXPECT_FALSE(template_joint(made, "left_hand_tip").foot);
  EXPECT_TRUE(template_joint(made, "hips").fat && template_joint(made, "chest").fat);
  const TemplateJoint thumb = template_joint(made, "thumb.left");
  ASSERT_GE(thumb.mirror, 0);
  EXPECT_EQ(made.joints[static_cast<std::size_t>(thumb.mirror)].name, "thumb.right");

  const Mesh mesh = test::capsule_mesh(test::person());
  const Skeleton rig = detailed_rig();
  const Skeleton embedded = embed_skeleton(mesh, made).skeleton;
  EXPECT_EQ(embedded.names, rig.names);
  EXPECT_EQ(embedded.parents, rig.parents);
  const auto joints = embedded.positions();
  std::map<std::string, Eigen::Vector3d> found;
  for (std::size_t j = 0; j < joints.size(); ++j) found[embedded.names[j]] = joints[j];
  for (const auto& [name, place] : test::person_joints())
    EXPECT_LT((found[name] - place).norm(), 0.09) << name << " at " << found[name].transpose();
  // A carried joint keeps its distance, but for the scale of the bone it follows.
  const double reach = (found["thumb_end.left"] - found["left_hand"]).norm();
  EXPECT_GT(reach, 0.02);
  EXPECT_LT(reach, 0.12);
  EXPECT_NEAR(found["ground"].z(), -0.5, 0.05);
}

TEST(EmbeddingTemplate, NamesTellSides) {
  // A pose that mirrors nothing.
  const Skeleton posed =
      skeleton_from_joints({{0, 0, 0}, {0.3, 0, 0.3}, {-0.1, 0, -0.4}, {0.2, 0.3, 0}, {-0.4, 0, 0.1}, {0, 0, 0.5}},
                           {-1, 0, 0, 0, 0, 0}, {"root", "arm.L", "arm.R", "LeftLeg", "RightLeg", "tail"});
  const TemplateSkeleton made = template_from_skeleton(posed);
  EXPECT_EQ(made.joints[1].mirror, 2);
  EXPECT_EQ(made.joints[3].mirror, 4);
  EXPECT_EQ(made.joints[5].mirror, -1);
}

TEST(EmbeddingTemplate, RefusesBrokenTrees) {
  TemplateSkeleton skeleton = biped_template();
  skeleton.joints[3].parent = 9;
  EXPECT_THROW(check(skeleton), InputError);
  skeleton = biped_template();
  skeleton.joints[3].parent = -1;
  EXPECT_THROW(check(skeleton), InputError);
  skeleton = biped_template();
  skeleton.joints[3].position.x() = std::nan("");
  EXPECT_THROW(check(skeleton), InputError);
  skeleton = biped_template();
  skeleton.joints[3].mirror = 99;
  EXPECT_THROW(check(skeleton), InputError);
  skeleton.joints.clear();
  EXPECT_THROW(check(skeleton), InputError);
  EXPECT_THROW(template_from_skeleton(Skeleton{}), InputError);
  EXPECT_THROW(template_from_skeleton(skeleton_from_joints({{0, 0, 0}, {0, 0, 0}}, {-1, 0})), InputError);
}

TEST(EmbeddingTemplate, ALoneChainIsATemplate) {
  const TemplateSkeleton snake = template_from_skeleton(
      skeleton_from_joints({{0, -0.4, 0}, {0, -0.1, 0}, {0, 0.1, 0}, {0, 0.4, 0}}, {-1, 0, 1, 2}));
  const Mesh mesh = test::capsule_mesh({{{0, -0.45, 0}, {0, 0.45, 0}, 0.05}});
  const auto joints = embed_skeleton(mesh, snake).skeleton.positions();
  ASSERT_EQ(joints.size(), 4u);
  EXPECT_LT(joints[0].y(), -0.3);
  EXPECT_GT(joints[3].y(), 0.3);
  for (const Eigen::Vector3d& joint : joints) EXPECT_LT(std::hypot(joint.x(), joint.z()), 0.02);
}

}  // namespace

}  // namespace anigen::rigging
