// Every real rigged file: imports, agrees with the manifest, and poses as glTF's formula says.
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <fstream>
#include <map>
#include <memory>
#include <set>
#include <sstream>

#include "anigen/asset/skinning.h"
#include "anigen/asset/validate.h"
#include "anigen/io/gltf.h"
#include "tests/io/gltf_import_reference.h"
#include "tests/io/gltf_import_support.h"
#include "tests/support/paths.h"

namespace anigen::io {
namespace {

namespace fs = std::filesystem;
using test::has_note;

// Skins of these files place joints they share differently; their vertices are posed into one of the bind poses.
const std::set<std::string> kConflicts = {};
// Compressed files: the reference reader cannot read them.
const std::set<std::string> kCompressed = {"neg_draco_flamingo", "neg_meshopt_triangles"};

struct ManifestRow {
  std::size_t vertices = 0, faces = 0, joints = 0, animations = 0;
};

// Columns: name, category, file, vertices, faces, joints, skins, animations, …; keyed by the file.
std::map<std::string, ManifestRow> read_manifest() {
  std::map<std::string, ManifestRow> rows;
  std::ifstream in(test::assets_dir() / "MANIFEST.csv");
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    std::vector<std::string> cells;
    std::stringstream text(line);
    for (std::string cell; cells.size() < 8 && std::getline(text, cell, ',');) cells.push_back(cell);
    if (cells.size() == 8) {
      rows[cells[2]] = {std::stoul(cells[3]), std::stoul(cells[4]), std::stoul(cells[5]), std::stoul(cells[7])};
    }
  }
  return rows;
}

std::vector<fs::path> rigged_files() {
  std::vector<fs::path> files;
  std::error_code error;
  for (const auto& entry : fs::recursive_directory_iterator(test::assets_dir() / "rigged", error)) {
    if (entry.path().extension() == ".glb" || entry.path().extension() == ".gltf") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::size_t count_of(const ImportedAsset& imported, const std::string& code) {
  for (const ImportNote& note : imported.notes) {
    if (note.code == code) return std::stoul(note.message);
  }
  return 0;
}

double largest_distance(const std::vector<Eigen::Vector3f>& a, const std::vector<Eigen::Vector3f>& b) {
  double largest = 0.0;
  for (std::size_t v = 0; v < a.size(); ++v) {
    const double distance = static_cast<double>((a[v] - b[v]).norm());
    if (b[v].allFinite()) largest = std::max(largest, a[v].allFinite() ? distance : 1e300);
  }
  return largest;
}

class RiggedFile : public testing::TestWithParam<fs::path> {
 protected:
  std::string name() const { return GetParam().stem().string(); }
};

TEST_P(RiggedFile, ImportsAsTheManifestSays) {
  const ImportedAsset imported = read_gltf(GetParam());
  const Asset& asset = imported.asset;
  const std::vector<std::string> findings = validate(asset);
  EXPECT_TRUE(findings.empty()) << findings.front();
  const auto manifest = read_manifest();
  const auto row = manifest.find(fs::relative(GetParam(), test::assets_dir()).string());
  ASSERT_NE(row, manifest.end());
  EXPECT_EQ(asset.mesh.vertices.size(), row->second.vertices);
  EXPECT_EQ(asset.mesh.faces.size() + count_of(imported, "degenerate_faces"), row->second.faces);
  // The manifest counts the joints of the skins; the importer adds what it made and promoted.
  const std::size_t made = has_note(imported, "several_roots") ? 1 : 0;
  EXPECT_EQ(asset.skeleton.size(), row->second.joints + made + count_of(imported, "promoted_node"));
  EXPECT_EQ(asset.animations.size(), row->second.animations);
  EXPECT_EQ(has_note(imported, "bind_pose_conflict"), kConflicts.count(name()) != 0);
}

TEST_P(RiggedFile, BindPoseReproducesTheMesh) {
  const Asset asset = read_gltf(GetParam()).asset;
  // W · C⁻¹ is the identity up to the rounding of an inverse of a badly scaled matrix.
  EXPECT_LE(largest_distance(asset.mesh.vertices, skin_vertices(asset, asset.skeleton.bind)),
            1e-5 * bounding_box(asset.mesh.vertices).diagonal());
}

TEST_P(RiggedFile, PosesLikeTheFormula) {
  if (kCompressed.count(name()) != 0) GTEST_SKIP() << "not supported: a second reader of compressed files";
  const Asset asset = read_gltf(GetParam()).asset;
  const test::GltfReference reference(GetParam());
  const std::vector<Eigen::Vector3f> expected = reference.vertices();
  ASSERT_EQ(expected.size(), asset.mesh.vertices.size());
  EXPECT_EQ(asset.mesh.faces.size(), reference.triangles());
  if (kConflicts.count(name()) != 0) return;
  EXPECT_LE(largest_distance(skin_vertices(asset, asset.skeleton.rest), expected),
            1e-4 * bounding_box(expected).diagonal());
}

TEST_P(RiggedFile, MovesLikeTheFormula) {
  const Asset asset = read_gltf(GetParam()).asset;
  const std::size_t shown = std::min<std::size_t>(asset.animations.size(), 3);
  const bool comparable = kCompressed.count(name()) == 0 && kConflicts.count(name()) == 0;
  const auto reference = comparable ? std::make_unique<test::GltfReference>(GetParam()) : nullptr;
  const std::vector<bool> loose = reference ? reference->follows_no_joint() : std::vector<bool>();
  for (std::size_t a = 0; a < shown; ++a) {
    const double duration = asset.animations[a].duration();
    for (const double part : {0.0, 0.37, 0.81, 1.0}) {
      const Pose pose = sample(asset.animations[a], asset.skeleton, part * duration);
      const std::vector<Eigen::Vector3f> moved = skin_vertices(asset, pose);
      for (const Eigen::Vector3f& v : moved) ASSERT_TRUE(v.allFinite()) << asset.animations[a].name;
      if (!reference) continue;
      std::vector<Eigen::Vector3f> expected = reference->vertices(static_cast<int>(a), part * duration);
      // The importer binds these to the root, so that the asset is one piece.
      for (std::size_t v = 0; v < expected.size(); ++v) {
        if (loose[v]) expected[v] = moved[v];
      }
      EXPECT_LE(largest_distance(moved, expected), 1e-4 * bounding_box(expected).diagonal())
          << asset.animations[a].name << " at " << part;
    }
  }
}

std::string test_name(const testing::TestParamInfo<fs::path>& info) {
  std::string name = info.param.stem().string();
  std::replace_if(
      name.begin(), name.end(), [](char c) { return std::isalnum(static_cast<unsigned char>(c)) == 0; }, '_');
  return name;
}

GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(RiggedFile);
INSTANTIATE_TEST_SUITE_P(Assets, RiggedFile, testing::ValuesIn(rigged_files()), test_name);

TEST(RiggedFiles, AreThere) {
  if (!fs::exists(test::assets_dir() / "rigged")) GTEST_SKIP() << test::assets_dir() << " is not there";
  EXPECT_GE(rigged_files().size(), 40u);
}

TEST(RiggedFiles, RepairsAreReportedWithTheirCounts) {
  const fs::path rigged = test::assets_dir() / "rigged";
  if (!fs::exists(rigged)) GTEST_SKIP() << test::assets_dir() << " is not there";
  EXPECT_EQ(count_of(read_gltf(rigged / "arthropod/q_crab_nan.glb"), "nan_weights"), 6u);
  EXPECT_EQ(count_of(read_gltf(rigged / "plant/dcl_tree/Tree.gltf"), "zero_weights"), 44u);
  EXPECT_GT(count_of(read_gltf(rigged / "synthetic/godot_unnormalised.glb"), "unnormalised_weights"), 0u);
  EXPECT_EQ(count_of(read_gltf(rigged / "negative/neg_draco_flamingo.glb"), "decoded_draco"), 2u);
  EXPECT_TRUE(has_note(read_gltf(rigged / "negative/neg_meshopt_triangles.glb"), "decoded_meshopt"));
  EXPECT_TRUE(has_note(read_gltf(rigged / "synthetic/ag_skin_no_ibm/Animation_Skin_04.gltf"), "missing_inverse_bind"));
  EXPECT_EQ(count_of(read_gltf(rigged / "quadruped/q_stag.glb"), "rigid_mesh_on_joint"), 1u);
  EXPECT_EQ(count_of(read_gltf(rigged / "machine/q_tank.glb"), "unskinned_mesh"), 2u);
  EXPECT_TRUE(has_note(read_gltf(rigged / "humanoid/greenman.glb"), "several_roots"));
}

}  // namespace
}  // namespace anigen::io
