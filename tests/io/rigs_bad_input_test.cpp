#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <ostream>

#include "anigen/core/error.h"
#include "anigen/io/rigs/shape_source.h"
#include "tests/io/array_file_bytes.h"
#include "tests/support/rig_files.h"

namespace anigen::io {
namespace {

namespace fs = std::filesystem;
using test::RigFile;

using Writer = void (*)(const fs::path& folder, const RigFile& rig);

/// The four formats that can say anything, sound or not.
const std::map<std::string, std::pair<const char*, Writer>>& formats() {
  static const std::map<std::string, std::pair<const char*, Writer>> all = {
      {"npz", {"sample.npz", [](const fs::path& file, const RigFile& rig) { test::write_rig_npz(file, rig); }}},
      {"xl", {"xl.npz", [](const fs::path& file, const RigFile& rig) { test::write_articulation_xl(file, {rig}); }}},
      {"text", {"sample.txt", [](const fs::path& file, const RigFile& rig) { test::write_text_rig(file, rig); }}},
      {"pt", {"list.pt", [](const fs::path& file, const RigFile& rig) { test::write_anymate(file, {rig}); }}}};
  return all;
}

struct Case {
  const char* name;
  void (*damage)(RigFile& rig);
  std::map<std::string, std::string> refusals;  ///< by format: place and problem; formats left out read it
  std::string note;                             ///< among the notes of formats that read it
  std::size_t joints, faces;                    ///< that they then have
  bool has_skin;
};

void PrintTo(const Case& c, std::ostream* out) { *out << c.name; }

/// What each kind of bad input gives, by format. Positions of joints count from 0, lines from 1.
const std::vector<Case>& cases() {
  static const std::vector<Case> all = {
      {"empty_skeleton",
       [](RigFile& rig) {
         rig.keep_joints(0);
         rig.has_skin = false;
       },
       {{"npz", "the skeleton has no joint"},
        {"xl", "sample sample: the skeleton has no joint"},
        {"text", "the skeleton has no joint"},
        {"pt", "sample sample: the skeleton has no joint"}},
       "",
       0,
       0,
       false},
      {"no_skeleton_in_file",
       [](RigFile& rig) { rig.has_skeleton = rig.has_skin = false; },
       {{"text", "the skeleton has no joint"}},
       "no skeleton: skeleton and skin metrics are not computed",
       0,
       4,
       false},
      {"single_joint",
       [](RigFile& rig) {
         rig.keep_joints(1);
         rig.skin.assign(6, 1.0f);
       },
       {{"pt", "sample sample, mesh_skins_index[0]: names bone 0 of 0"}},
       "",
       1,
       4,
       true},
      {"forest",
       [](RigFile& rig) {
         rig.parents = {-1, 0, -1};
       },
       {{"pt", "sample sample, mesh_skins_index[2]: names bone 1 of 1"}},
       "a forest of 2 trees",
       3,
       4,
       true},
      {"two_identical_joints",
       [](RigFile& rig) {
         rig.joints = {0, 0, 0, 0, 0, 0.5, 0, 0, 0.5};
         rig.has_skin = false;
       },
       {},
       "1 joints lie exactly where another one does",
       3,
       4,
       false},
      {"nan_joint",
       [](RigFile& rig) { rig.joints[4] = std::nan(""); },
       {{"npz", "joints[1]: is not finite"},
        {"xl", "sample sample, joints[1]: is not finite"},
        {"text", "line 2: \"nan\" is not finite"},
        {"pt", "sample sample, joints[1]: is not finite"}},
       "",
       0,
       0,
       false},
      {"weights_for_too_few_vertices",
       [](RigFile& rig) {
         rig.skin.resize(15);
         rig.skin_rows = 5;
       },
       {{"npz", "skin: its shape is [5, 3], expected [6, 3]"},
        {"xl", "sample sample, skinning_weights_shape: weights for 5 vertices and 3 joints, but there are 6 and 3"},
        {"pt", "sample sample, mesh_skins_index: its shape is [5, 3], expected [6, any]"}},
       "1 vertices without a weight are bound to joint 0",  // a text rig leaves out what weighs nothing
       3,
       4,
       true},
      {"weights_for_too_many_vertices",
       [](RigFile& rig) {
         rig.skin.insert(rig.skin.end(), {1, 0, 0});
         rig.skin_rows = 7;
       },
       {{"npz", "skin: its shape is [7, 3], expected [6, 3]"},
        {"xl", "sample sample, skinning_weights_shape: weights for 7 vertices and 3 joints, but there are 6 and 3"},
        {"text", "line 11: weights vertex 6 of the 6 in "},
        {"pt", "sample sample, mesh_skins_index: its shape is [7, 3], expected [6, any]"}},
       "",
       0,
       0,
       false},
      {"nan_weight",
       [](RigFile& rig) { rig.skin[0] = std::nanf(""); },
       {{"npz", "skin: a weight is not finite"},
        {"xl", "sample sample, skinning_weights_value[0]: a weight is not finite"},
        {"text", "line 5: \"nan\" is not finite"},
        {"pt", "sample sample, mesh_skins_index[0]: a weight is not finite"}},
       "",
       0,
       0,
       false},
      {"no_skin",
       [](RigFile& rig) { rig.has_skin = false; },
       {},
       "no skin weights: skin metrics are not computed",
       3,
       4,
       false},
      {"mesh_without_faces",
       [](RigFile& rig) {
         rig.faces.clear();
         rig.has_skin = false;
       },
       {},
       "no faces: the mesh is a point set",
       3,
       0,
       false},
      {"face_beyond_vertices",
       [](RigFile& rig) { rig.faces[4] = 6; },
       {{"npz", "faces[1]: names vertex 6 of 6"},
        {"xl", "sample sample, faces[1]: names vertex 6 of 6"},
        {"text", "line 8: vertex 7 does not exist: the file has 6"},
        {"pt", "sample sample, mesh_face[1]: names vertex 6 of 6"}},
       "",
       0,
       0,
       false},
      {"cycle",
       [](RigFile& rig) {
         rig.parents = {1, 2, 0};
       },
       {{"npz", "joint 0: is its own ancestor: the skeleton has a cycle"},
        {"xl", "sample sample, joint 0: is its own ancestor: the skeleton has a cycle"},
        {"text", "joint 0: is its own ancestor: the skeleton has a cycle"},
        {"pt", "sample sample, joint 0: is its own ancestor: the skeleton has a cycle"}},
       "",
       0,
       0,
       false}};
  return all;
}

class BadInput : public testing::TestWithParam<Case> {};

TEST_P(BadInput, GivesADefinedShapeOrAnErrorThatNamesThePlace) {
  const Case& c = GetParam();
  for (const auto& [format, writer] : formats()) {
    SCOPED_TRACE(format);
    const test::TemporaryFolder folder;
    RigFile rig;
    if (format == "pt") {  // its weights are per bone, of which there are two
      for (std::size_t v = 0; v < 6; ++v) rig.skin[3 * v] += rig.skin[3 * v + 2], rig.skin[3 * v + 2] = 0;
    }
    c.damage(rig);
    const fs::path file = folder / writer.first;
    writer.second(file, rig);
    RiggedShape shape;
    std::string refused;
    try {
      shape = open_source(file)->read("sample");
    } catch (const InputError& error) {
      EXPECT_EQ(error.file().find(folder.path().string()), 0u) << error.what();
      refused = error.place() + (error.place().empty() ? "" : ": ") + error.problem();
    }
    const auto wanted = c.refusals.find(format);
    if (wanted != c.refusals.end()) {
      EXPECT_EQ(refused.substr(0, wanted->second.size()), wanted->second) << refused;
      EXPECT_FALSE(refused.empty());
      continue;
    }
    ASSERT_EQ(refused, "");
    EXPECT_EQ(shape.joints.size(), c.joints);
    EXPECT_EQ(shape.mesh.faces.size(), c.faces);
    EXPECT_EQ(shape.has_skin(), c.has_skin);
    if (!c.note.empty()) {
      EXPECT_NE(std::find(shape.notes.begin(), shape.notes.end(), c.note), shape.notes.end())
          << testing::PrintToString(shape.notes);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Table, BadInput, testing::ValuesIn(cases()),
                         [](const auto& info) { return std::string(info.param.name); });

struct BadFile {
  const char* file;
  std::string content, refusal;
};

TEST(BadInputFile, IsRefusedWithItsReason) {
  const std::string pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12\n";
  const std::string is_pointer = "is a Git LFS pointer, not the file itself; fetch it with: git lfs pull";
  const std::vector<BadFile> files = {
      {"a.glb", pointer, is_pointer},
      {"a.npz", pointer, is_pointer},
      {"a.pt", pointer, is_pointer},
      {"a.txt", pointer, is_pointer},
      {"b.glb", "", "byte 0: the file is empty"},
      {"b.npz", "", "byte 0: the file is empty"},
      {"c.blend", "x", "not supported: rigs in .blend files; convert them to .glb"},
      {"d.csv", "pred,gt\n", "a CSV of pairs names both sides at once"},
      {"missing.glb", "", "there is no such file or folder"},
      {"e.txt", "joints a 0 0\n", "line 1: the line ends where a number should be"},
      {"f.txt", "joints a 0 0 0\njoints a 0 0 1\nroot a\n", "line 2: the joint a is given twice"},
      {"g.txt", "joints a 0 0 0\nhier a b\nroot a\n", "line 2: there is no joint \"b\""},
      {"h.txt", "joints a 0 0 0\n", "there is no root line"},
      {"i.txt", "joints a 0 0 0\nroot a\nroot a\n", "line 3: there is a second root line"},
      {"j.txt", "joints a 0 0 0\njoints b 0 0 0\nhier a b\nroot b\n", "the root b has the parent a"},
      {"k.txt", "joints a 0 0 0\nroot a\nskin 0 a 1\nskin 0 a 1\n", "line 4: vertex 0 is weighted twice"},
      {"l.txt", "joints a 0 0 0\nroot a\nskin 0.5 a 1\n", "line 3: a vertex number is whole and not negative"},
      {"m.txt", "joints a 0 0 0\nroot a\nbones a\n", "line 3: \"bones\" is none of joints, root, hier, skin"},
      {"n.txt", "joints a 0 0 0 1\nroot a\n", "line 1: \"1\" after the end of the line's content"},
      {"o.txt", "joints a 0 0 0\nroot a\nskin 0 a\n", "line 3: the line ends where a number should be"},
      {"p.txt", "# a note\n\njoints a 0 0 x\n", "line 3: \"x\" is not a number"}};
  const test::TemporaryFolder folder;
  for (const BadFile& bad : files) {
    const fs::path path = folder / bad.file;
    if (std::string(bad.file) != "missing.glb") test::write_quickly(path, bad.content);
    EXPECT_EQ(test::refusal([&] {
                const auto source = open_source(path);
                source->read(source->ids().front());
              }),
              bad.refusal)
        << bad.file;
  }
}

TEST(BadInputFile, TruncatedAndDamagedFilesOnlyThrowErrors) {
  const test::TemporaryFolder folder;
  const auto read_all = [](const fs::path& path) {
    const auto source = open_source(path);
    for (const std::string& id : source->ids()) source->read(id);
  };
  for (const auto& [format, writer] : formats()) {
    SCOPED_TRACE(format);
    const fs::path file = folder / writer.first;
    writer.second(file, RigFile());
    std::ifstream in(file, std::ios::binary);
    const std::string bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
    EXPECT_GT(test::read_damaged(bytes, writer.first, read_all, 100), 20);
  }
}

}  // namespace
}  // namespace anigen::io
