#include "anigen/eval/lint_files.h"

#include <gtest/gtest.h>

#include <fstream>

#include "anigen/core/error.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::eval {
namespace {

TEST(LintPath, ReadsAFileOrAllRigsOfAFolder) {
  const test::TemporaryFolder folder;
  test::write_glb(folder / "a.glb", test::RigFile());
  test::write_rig_npz(folder / "b.npz", test::RigFile());
  std::ofstream(folder / "c.glb") << "glTF, but no more";
  const std::vector<LintedFile> one = lint_path(folder / "a.glb");
  ASSERT_EQ(one.size(), 1U);
  EXPECT_EQ(one[0].rejection, "");
  EXPECT_EQ(one[0].lint.figures["joints"], 3);
  const std::vector<LintedFile> all = lint_path(folder.path());
  ASSERT_EQ(all.size(), 3U);
  EXPECT_NE(all[2].rejection, "");
  const Json json = to_json(all);
  ASSERT_EQ(json.size(), 3U);
  EXPECT_TRUE(json[0].contains("findings"));
  EXPECT_TRUE(json[2].contains("rejected"));
  EXPECT_TRUE(to_json(one).is_object());
  EXPECT_NE(to_text(all[2]).find("rejected"), std::string::npos);
  EXPECT_NE(to_text(one[0]).find("error"), std::string::npos);
}

TEST(LintPath, RepairsOfTheImporterAreFindings) {
  const test::TemporaryFolder folder;
  test::RigFile rig;
  for (int j = 0; j < rig.skin_columns; ++j) rig.skin[static_cast<std::size_t>(j)] = 0.0f;
  test::write_rig_npz(folder / "bare.npz", rig);
  const std::vector<LintedFile> files = lint_path(folder / "bare.npz");
  ASSERT_EQ(files.size(), 1U);
  ASSERT_EQ(files[0].rejection, "");
  const lint::LintFinding* finding = files[0].lint.find("unweighted-vertices");
  ASSERT_NE(finding, nullptr);
  EXPECT_EQ(finding->count, 1U);
  EXPECT_EQ(finding->severity, lint::Severity::kWarning);
}

TEST(LintPath, TellsWhatIsNoRig) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "flat.obj") << "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
  const std::vector<LintedFile> mesh = lint_path(folder / "flat.obj");
  ASSERT_EQ(mesh.size(), 1U);
  EXPECT_NE(mesh[0].lint.find("no-skeleton"), nullptr);
  EXPECT_NE(mesh[0].lint.find("no-weights"), nullptr);
  // In a folder as alone.
  Asset bare;
  bare.mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  bare.mesh.faces = {{0, 1, 2}};
  io::ExportOptions options;
  options.require_rig = false;
  std::filesystem::create_directories(folder / "models");
  io::write_gltf(folder / "models/bare.glb", bare, options);
  const std::vector<LintedFile> all = lint_path(folder / "models");
  ASSERT_EQ(all.size(), 1U);
  EXPECT_EQ(all[0].rejection, "");
  EXPECT_NE(all[0].lint.find("no-skeleton"), nullptr);
  std::ofstream(folder / "config.json") << "{}";
  EXPECT_THROW(lint_path(folder / "config.json"), InputError);
  EXPECT_THROW(lint_path(folder / "none.glb"), InputError);
}

}  // namespace
}  // namespace anigen::eval
