#include "anigen/lint/lint.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <limits>
#include <set>

#include "anigen/core/parallel.h"
#include "anigen/core/random.h"
#include "anigen/core/text.h"
#include "anigen/creatures/body.h"
#include "anigen/geometry/primitives.h"
#include "tests/lint/doll.h"
#include "tests/support/hinged_boxes.h"
#include "tests/support/paths.h"

namespace anigen::lint {
namespace {

using test::change_rows;
using test::Doll;
using test::joint_named;

std::string findings_of(const RigLint& lint) {
  return joined(lint.findings, "; ", [](const LintFinding& f) { return f.code + ": " + f.sentence; });
}

/// The clean doll with one defect.
struct Defect {
  const char* name;
  const char* code;
  Severity severity;
  void (*make)(Asset& doll);
};

void bind_all_at_random(Asset& doll) {
  Rng rng(3, "lint_test");
  const std::size_t joints = doll.skeleton.size();
  change_rows(doll, [&](std::size_t, std::vector<Influence>& row) {
    row = {{static_cast<std::int32_t>(rng.index(joints)), 1.0f}};
  });
}

const std::vector<Defect>& defects() {
  static const std::vector<Defect> list = {
      {"rows without weights", "unweighted-vertices", Severity::kError,
       [](Asset& doll) {
         change_rows(doll, [](std::size_t v, auto& row) {
           if (v % 50 == 7) row.clear();
         });
       }},
      {"a weight that is not a number", "bad-weights", Severity::kError,
       [](Asset& doll) { doll.skin.influences[40].weight = std::numeric_limits<float>::quiet_NaN(); }},
      {"a negative weight", "bad-weights", Severity::kError,
       [](Asset& doll) { doll.skin.influences[40].weight = -0.5f; }},
      {"a joint that does not exist", "bad-weights", Severity::kError,
       [](Asset& doll) { doll.skin.influences[40].joint = 99; }},
      {"halved rows", "weight-sums", Severity::kError,
       [](Asset& doll) {
         change_rows(doll, [](std::size_t v, auto& row) {
           for (Influence& influence : row) influence.weight *= v % 9 == 0 ? 0.5f : 1.0f;
         });
       }},
      {"six joints at a vertex", "many-influences", Severity::kNote,
       [](Asset& doll) {
         change_rows(doll, [](std::size_t v, auto& row) {
           if (v != 5) return;
           row.clear();
           for (std::int32_t joint = 0; joint < 6; ++joint) row.push_back({joint, 1.0f / 6.0f});
         });
       }},
      {"a foot that hangs on the leg", "dead-joints", Severity::kWarning,
       [](Asset& doll) {
         const std::set<std::int32_t> lost = {joint_named(doll, "foot.L"), joint_named(doll, "toe.L")};
         const std::int32_t leg = joint_named(doll, "lower_leg.L");
         change_rows(doll, [&](std::size_t, auto& row) {
           if (lost.count(row[0].joint) > 0) row = {{leg, 1.0f}};
         });
       }},
      {"a toe far away", "joints-outside", Severity::kError,
       [](Asset& doll) {
         const auto toe = static_cast<std::size_t>(joint_named(doll, "toe.L"));
         doll.skeleton.bind[toe].topRightCorner<3, 1>() = Eigen::Vector3d(0.0, -3.0, 0.0);
       }},
      {"a skeleton in centimetres", "joints-outside", Severity::kError,
       [](Asset& doll) {
         for (Eigen::Matrix4d& bind : doll.skeleton.bind) bind.topRightCorner<3, 1>() *= 100.0;
       }},
      {"a skeleton behind the body", "joints-off-body", Severity::kNote,
       [](Asset& doll) {
         for (Eigen::Matrix4d& bind : doll.skeleton.bind) bind(1, 3) += 0.3;
       }},
      {"the crown of the head on the hips", "weight-islands", Severity::kWarning,
       [](Asset& doll) {
         const std::int32_t hips = joint_named(doll, "hips"), head = joint_named(doll, "head");
         change_rows(doll, [&](std::size_t v, auto& row) {
           if (doll.mesh.vertices[v].z() > 0.45f) row = {{head, 0.7f}, {hips, 0.3f}};
         });
       }},
      {"a ball at the foot that hears the head", "shell-bleed", Severity::kWarning,
       [](Asset& doll) {
         Asset ball;
         ball.mesh = geometry::icosphere(0, 0.02);
         for (Eigen::Vector3f& vertex : ball.mesh.vertices) {
           vertex += Eigen::Vector3f(0.05f, -0.2f, -0.45f);
           ball.skin.append_row({{joint_named(doll, "foot.L"), 0.8f}, {joint_named(doll, "head"), 0.2f}});
         }
         test::add_part(doll, ball);
       }},
      {"joints drawn at random: stretched", "stretched-faces", Severity::kError, bind_all_at_random},
      {"joints drawn at random: inverted", "inverted-faces", Severity::kWarning, bind_all_at_random},
      {"clothes that lag behind in stripes", "self-intersections", Severity::kWarning,
       [](Asset& doll) {
         Asset clothes = Doll(1.04).asset;
         change_rows(clothes, [](std::size_t v, auto& row) {
           if (v % 2 != 0) return;
           for (Influence& influence : row) influence.weight *= 0.7f;
           row.push_back({0, 0.3f});
         });
         SkinWeights merged;
         for (std::size_t v = 0; v < clothes.skin.rows(); ++v)
           merged.append_row({clothes.skin.row(v), clothes.skin.row(v) + clothes.skin.row_size(v)});
         clothes.skin = merged;
         test::add_part(doll, clothes);
       }},
      {"a joint without a name", "empty-names", Severity::kError, [](Asset& doll) { doll.skeleton.names[4].clear(); }},
      {"a name given twice", "repeated-names", Severity::kError,
       [](Asset& doll) { doll.skeleton.names[2] = doll.skeleton.names[1]; }},
      {"a name with a slash", "refused-names", Severity::kWarning,
       [](Asset& doll) { doll.skeleton.names[1] = "spine/lower"; }},
      {"a foot without a side", "unpaired-names", Severity::kWarning,
       [](Asset& doll) { doll.skeleton.names[static_cast<std::size_t>(joint_named(doll, "foot.L"))] = "foot"; }},
      {"one pair of arms swapped", "swapped-sides", Severity::kWarning,
       [](Asset& doll) {
         auto& names = doll.skeleton.names;
         std::swap(names[static_cast<std::size_t>(joint_named(doll, "lower_arm.L"))],
                   names[static_cast<std::size_t>(joint_named(doll, "lower_arm.R"))]);
       }},
      {"all sides swapped", "mirrored-names", Severity::kNote,
       [](Asset& doll) {
         for (std::string& name : doll.skeleton.names) {
           if (name.size() > 2 && name[name.size() - 2] == '.') name.back() = name.back() == 'L' ? 'R' : 'L';
         }
       }},
      {"a doll on its back", "not-upright", Severity::kWarning,
       [](Asset& doll) {
         test::turn(doll, Eigen::AngleAxisd(kPi / 2.0, Eigen::Vector3d::UnitX()).toRotationMatrix());
       }},
      {"a mirrored joint", "mirrored-bind", Severity::kWarning,
       [](Asset& doll) { doll.skeleton.bind[5].col(0) *= -1.0; }},
      {"a joint scaled by axis", "uneven-bind-scale", Severity::kNote,
       [](Asset& doll) { doll.skeleton.bind[5].col(1) *= 2.0; }},
      {"joints of scale 100", "scaled-bind", Severity::kNote,
       [](Asset& doll) {
         for (Eigen::Matrix4d& bind : doll.skeleton.bind) bind.topLeftCorner<3, 3>() *= 100.0;
       }},
      {"a root at an angle", "tilted-root", Severity::kNote,
       [](Asset& doll) {
         doll.skeleton.bind[0].topLeftCorner<3, 3>() =
             Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitY()).toRotationMatrix();
       }},
      {"a vertex that is not a number", "broken-asset", Severity::kError,
       [](Asset& doll) { doll.mesh.vertices[9].y() = std::numeric_limits<float>::quiet_NaN(); }},
      {"a face of a missing vertex", "broken-asset", Severity::kError,
       [](Asset& doll) { doll.mesh.faces[9][1] = 1'000'000; }},
      {"a parent after its child", "broken-asset", Severity::kError, [](Asset& doll) { doll.skeleton.parents[3] = 9; }},
      {"a bind matrix without an inverse", "broken-asset", Severity::kError,
       [](Asset& doll) { doll.skeleton.bind[3].col(2).setZero(); }},
      {"fewer rows than vertices", "broken-asset", Severity::kError,
       [](Asset& doll) { doll.mesh.vertices.emplace_back(0.0f, 0.0f, 0.0f); }},
      {"offsets that go back", "broken-asset", Severity::kError, [](Asset& doll) { doll.skin.offsets[8] = 0; }},
      {"no weights", "no-weights", Severity::kError, [](Asset& doll) { doll.skin = SkinWeights(); }},
      {"no skeleton", "no-skeleton", Severity::kError, [](Asset& doll) { doll.skeleton = Skeleton(); }},
      {"no mesh", "no-mesh", Severity::kError, [](Asset& doll) {
         doll.mesh = Mesh();
         doll.skin = SkinWeights();
       }}};
  return list;
}

TEST(LintRig, FindsNothingInACleanRig) {
  const RigLint lint = lint_rig(Doll().asset);
  EXPECT_EQ(lint.count(Severity::kWarning), 0U) << findings_of(lint);
  for (const char* figure : {"unweighted_share", "far_weight_islands", "shell_bleed_share", "dead_joints",
                             "farthest_joint_outside", "joints_inside_share", "stretched_share", "inverted_share",
                             "newly_crossed_share", "head_over_feet", "unpaired_joints"})
    EXPECT_TRUE(lint.figures.contains(figure)) << figure;
  EXPECT_EQ(lint.figures["shells"], 7);
  EXPECT_EQ(lint.figures["joint_pairs"], 6);
  EXPECT_EQ(lint.figures["joints_inside_share"], 1.0);
}

// About a hinge in the gap the lid's corners swing into the base: no gap. About one far above both, it opens.
TEST(LintRig, GapsBetweenRigidParts) {
  const RigLint closed = lint_rig(test::hinged_boxes(0.01F, 0.0F));
  EXPECT_EQ(closed.figures["touching_shells"], 1);
  EXPECT_EQ(closed.figures["gap_growth_max"], 0.0);
  EXPECT_EQ(closed.figures["rigid_shell_share"], 1.0);
  EXPECT_NEAR(closed.figures["rigid_area_share"].get<double>(), 1.0, 1e-12);
  EXPECT_EQ(lint_rig(test::hinged_boxes(0.01F, 0.3F)).figures["rigid_shell_share"], 0.0);
  const Eigen::Vector3d aside(0.5, 0, 3);
  const RigLint open = lint_rig(test::hinged_boxes(0.01F, 0.0F, &aside));
  EXPECT_GT(open.figures["gap_growth_max"].get<double>(), 0.2);
  EXPECT_EQ(open.figures["gap_growth_mean"], open.figures["gap_growth_max"]) << "one pair";
}

TEST(LintRig, FindsEachDefectByItsCode) {
  for (const Defect& defect : defects()) {
    SCOPED_TRACE(defect.name);
    Asset doll = Doll().asset;
    defect.make(doll);
    const RigLint lint = lint_rig(doll);
    const LintFinding* finding = lint.find(defect.code);
    ASSERT_NE(finding, nullptr) << findings_of(lint);
    EXPECT_EQ(finding->severity, defect.severity) << finding->sentence;
    EXPECT_GT(finding->count, 0U);
    EXPECT_GT(finding->share, 0.0);
    EXPECT_LE(finding->share, 1.0);
    EXPECT_FALSE(finding->sentence.empty());
    EXPECT_FALSE(to_json(lint).dump(-1, ' ', false, Json::error_handler_t::replace).empty());
    EXPECT_EQ(finding_table(lint).rows.size(), lint.findings.size());
  }
}

TEST(LintRig, NamesTheWorstPlace) {
  Asset doll = Doll().asset;
  doll.skin.influences[doll.skin.offsets[123]].weight = -1.0f;
  const RigLint rows = lint_rig(doll);
  const LintFinding* bad = rows.find("bad-weights");
  ASSERT_NE(bad, nullptr);
  EXPECT_EQ(bad->count, 1U);
  EXPECT_EQ(bad->place.kind, "vertex");
  EXPECT_EQ(bad->place.index, 123U);
  EXPECT_EQ(bad->place.position, doll.mesh.vertices[123].cast<double>());

  doll = Doll().asset;
  const auto toe = static_cast<std::size_t>(joint_named(doll, "toe.R"));
  doll.skeleton.bind[toe](0, 3) = -9.0;
  const RigLint joints = lint_rig(doll);
  const LintFinding* outside = joints.find("joints-outside");
  ASSERT_NE(outside, nullptr);
  EXPECT_EQ(outside->count, 1U);
  EXPECT_EQ(outside->place.name, "toe.R");
}

TEST(LintRig, DoesNotDependOnUnitAndThreads) {
  Asset doll = Doll().asset;
  const auto toe = static_cast<std::size_t>(joint_named(doll, "toe.L"));
  doll.skeleton.bind[toe](1, 3) = -0.9;
  const RigLint before = lint_rig(doll);
  const int threads = thread_count();
  set_thread_count(1);
  EXPECT_EQ(to_json(lint_rig(doll)), to_json(before));
  set_thread_count(threads);
  Similarity centimetres;
  centimetres.scale = 128.0;  // a power of two: nothing is rounded
  apply(centimetres, doll);
  const RigLint after = lint_rig(doll);
  ASSERT_EQ(after.findings.size(), before.findings.size()) << findings_of(after);
  for (std::size_t i = 0; i < after.findings.size(); ++i) EXPECT_EQ(after.findings[i].code, before.findings[i].code);
  EXPECT_NEAR(after.figures["farthest_joint_outside"].get<double>(),
              before.figures["farthest_joint_outside"].get<double>(), 1e-6);
}

TEST(LintRig, VerticesSplitAtSeamsAreOne) {
  Asset doll = Doll().asset;
  Asset split;
  split.skeleton = doll.skeleton;
  for (const Triangle& face : doll.mesh.faces) {
    const auto first = static_cast<std::int32_t>(split.mesh.vertices.size());
    for (const std::int32_t corner : face) {
      split.mesh.vertices.push_back(doll.mesh.vertices[static_cast<std::size_t>(corner)]);
      split.skin.append_copy(doll.skin, static_cast<std::size_t>(corner));
    }
    split.mesh.faces.push_back({first, first + 1, first + 2});
  }
  const RigLint whole = lint_rig(doll), parts = lint_rig(split);
  EXPECT_EQ(parts.count(Severity::kWarning), 0U) << findings_of(parts);
  for (const char* figure : {"shells", "weight_islands", "stretched_share", "inverted_share"})
    EXPECT_EQ(parts.figures[figure], whole.figures[figure]) << figure;
}

TEST(LintRig, RepairsOfImportersAreFindingsButNoErrors) {
  LintOptions options;
  options.notes = {{"zero_weights", "12 vertices had no weight and were bound like their nearest neighbour"},
                   {"nan_weights", "3 vertices had weights that are not numbers"},
                   {"unnormalised_weights", "40 vertices had weights that did not sum to 1"},
                   {"several_roots", "2 joint roots were put under one made root joint"},
                   {"decoded_draco", "primitives decoded from KHR_draco_mesh_compression"}};
  const RigLint lint = lint_rig(Doll().asset, options);
  EXPECT_EQ(lint.count(Severity::kError), 0U) << findings_of(lint);
  ASSERT_NE(lint.find("unweighted-vertices"), nullptr);
  EXPECT_EQ(lint.find("unweighted-vertices")->count, 12U);
  EXPECT_EQ(lint.find("unweighted-vertices")->severity, Severity::kWarning);
  EXPECT_EQ(lint.find("weight-sums")->severity, Severity::kNote);
  EXPECT_NE(lint.find("several-roots"), nullptr);
  EXPECT_NE(lint.find("bad-weights"), nullptr);
}

TEST(LintRig, ControlsAndEndsMayBeWithoutWeights) {
  Asset doll = Doll().asset;
  auto positions = doll.skeleton.positions();
  auto parents = doll.skeleton.parents;
  auto names = doll.skeleton.names;
  const auto add = [&](const std::string& name, int parent) {
    names.push_back(name);
    parents.push_back(parent);
    positions.emplace_back(0.0, -0.3, -0.4);
    return static_cast<int>(names.size()) - 1;
  };
  add("PoleTarget.L", add("kneeIK.L", 0));
  add("PoleTarget.R", add("kneeIK.R", 0));
  add("tip", 2);
  doll.skeleton = skeleton_from_joints(positions, parents, names);
  const RigLint controls = lint_rig(doll);
  EXPECT_EQ(controls.find("dead-joints"), nullptr);
  EXPECT_EQ(controls.figures["joints_without_weights"], 5);
  names[15] = "knee.L";
  doll.skeleton = skeleton_from_joints(positions, parents, names);
  const RigLint knees = lint_rig(doll);
  const LintFinding* dead = knees.find("dead-joints");
  ASSERT_NE(dead, nullptr);
  EXPECT_EQ(dead->count, 2U);
  EXPECT_EQ(dead->place.name, "knee.L");
}

TEST(LintRig, TakesAnyInput) {
  EXPECT_NE(lint_rig(Asset()).find("no-mesh"), nullptr);
  Asset triangle;
  triangle.mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  triangle.mesh.faces = {{0, 1, 2}};
  EXPECT_NE(lint_rig(triangle).find("no-skeleton"), nullptr);
  bind_rigidly(triangle, "root");
  const RigLint sound = lint_rig(triangle);
  EXPECT_EQ(sound.count(Severity::kWarning), 0U) << findings_of(sound);

  Asset flat = triangle;
  flat.mesh.vertices.assign(3, Eigen::Vector3f(1, 1, 1));
  EXPECT_NE(lint_rig(flat).find("broken-asset"), nullptr);
  Asset large = triangle;
  large.mesh.vertices[1].x() = 1e20f;
  EXPECT_NE(lint_rig(large).find("broken-asset"), nullptr);
  Asset far = triangle;
  far.skeleton.bind[0](0, 3) = 1e200;
  EXPECT_NE(lint_rig(far).find("broken-asset"), nullptr);
  Asset no_offsets = triangle;
  no_offsets.skin.offsets.clear();
  EXPECT_NE(lint_rig(no_offsets).find("broken-asset"), nullptr);
  Asset nameless = triangle;
  nameless.skeleton.names.clear();
  EXPECT_NE(lint_rig(nameless).find("broken-asset"), nullptr);
  Asset boneless = triangle;
  boneless.skeleton.bind.clear();
  EXPECT_NE(lint_rig(boneless).find("broken-asset"), nullptr);
  Asset all_bad = triangle;
  for (Influence& influence : all_bad.skin.influences) influence.joint = -1;
  EXPECT_EQ(lint_rig(all_bad).find("bad-weights")->count, 3U);
}

TEST(LintRig, CreaturesHaveNoErrors) {
  for (const std::string& family : creatures::creature_families()) {
    const RigLint lint = lint_rig(creatures::make_creature(family, 11, 0));
    EXPECT_EQ(lint.count(Severity::kError), 0U) << family << ": " << findings_of(lint);
    if (lint.count(Severity::kWarning) > 0) std::printf("%s: %s\n", family.c_str(), findings_of(lint).c_str());
  }
}

TEST(LintRig, RigsOfArtistsHaveNoErrors) {
  const std::filesystem::path folder = test::assets_dir() / "rigged";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << folder << " is not there";
  std::size_t rigs = 0, with_warnings = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    const std::string extension = entry.path().extension().string();
    if (extension != ".glb" && extension != ".gltf") continue;
    const io::ImportedAsset imported = io::read_gltf(entry.path());
    LintOptions options;
    options.notes = imported.notes;
    const RigLint lint = lint_rig(imported.asset, options);
    ++rigs;
    EXPECT_EQ(lint.count(Severity::kError), 0U) << entry.path() << ": " << findings_of(lint);
    if (lint.count(Severity::kWarning) == 0) continue;
    ++with_warnings;
    for (const LintFinding& finding : lint.findings) {
      if (finding.severity == Severity::kWarning)
        std::printf("%s: %s: %s\n", entry.path().filename().c_str(), finding.code.c_str(), finding.sentence.c_str());
    }
  }
  EXPECT_GT(rigs, 0U);
  std::printf("%zu of %zu rigs have warnings\n", with_warnings, rigs);
}

}  // namespace
}  // namespace anigen::lint
