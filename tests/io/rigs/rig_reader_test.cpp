#include <gtest/gtest.h>
#include <atomic>
#include <cmath>
#include <map>
#include <thread>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/rigs/anymate.h"
#include "anigen/io/rigs/articulation_xl.h"
#include "anigen/io/rigs/rig_arrays.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/rigs/rig_reader.h"
#include "anigen/io/rigs/text_rig.h"
#include "tests/io/arrays/array_file_bytes.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"
#include "tests/support/scene_files.h"

namespace anigen::io {

namespace {

namespace fs = std::filesystem;
using test::RigFile;

/// Expectations of every format for the plain rig: vertices, joints and weights in its frame turned to Z up.
void expect_plain_rig(const RiggedShape& shape, bool y_up, const std::vector<float>& skin) {
  const RigFile rig;
  ASSERT_EQ(shape.mesh.vertices.size(), 6u);
  const auto turned = [y_up](double x, double y, double z) {
    return y_up ? Eigen::Vector3d(x, -z, y) : Eigen::Vector3d(x, y, z);
  };
  for (std::size_t v = 0; v < 6; ++v) {
    const float* p = &rig.vertices[3 * v];
    EXPECT_LT((shape.mesh.vertices[v].cast<double>() - turned(p[0], p[1], p[2])).norm(), 1e-6);
  }
  ASSERT_EQ(shape.mesh.faces.size(), 4u);
  EXPECT_EQ(shape.mesh.faces[3], (Triangle{2, 5, 4}));
  EXPECT_EQ(shape.joints.parents, rig.parents);
  for (std::size_t j = 0; j < 3; ++j) {
    const double* p = &rig.joints[3 * j];
    EXPECT_LT((shape.joints.positions[j] - turned(p[0], p[1], p[2])).norm(), 1e-6);
  }
  EXPECT_EQ(to_dense(shape.skin, 3), skin);
  EXPECT_EQ(shape.id, "sample");
}

class Formats : public testing::Test {
 protected:
  RiggedShape read(const fs::path& file, Axes axes = Axes::kFormat) const {
    return open_source(file, {axes})->read("sample");
  }
  test::TemporaryFolder folder_;
  const RigFile rig_;
};

TEST_F(Formats, PlainArrays) {
  test::write_rig_npz(folder_ / "sample.npz", rig_);
  expect_plain_rig(read(folder_ / "sample.npz"), false, rig_.skin);
  EXPECT_TRUE(read(folder_ / "sample.npz").notes.empty());
  expect_plain_rig(read(folder_ / "sample.npz", Axes::kYUp), true, rig_.skin);
}

TEST_F(Formats, NormalsAreRepairedOrLeftOut) {
  const float nan = std::nanf("");
  const NdArray vertices = NdArray::from<float>({0, 0, 0, 1, 0, 0, 0, 1, 0}, {3, 3});
  const NdArray faces = NdArray::from<std::int32_t>({0, 1, 2}, {1, 3});
  const auto shape = [&](const std::vector<float>& normals) {
    const auto count = static_cast<std::int64_t>(normals.size() / 3);
    return shape_from_rig_arrays(
        {{"vertices", vertices}, {"faces", faces}, {"vertex_normals", NdArray::from(normals, {count, 3})}}, "x", "f");
  };
  const std::vector<Eigen::Vector3f> repaired = shape({2, 0, 0, nan, 0, 1, 0, 0, 0}).mesh.normals;
  EXPECT_EQ(repaired, (std::vector<Eigen::Vector3f>{{1, 0, 0}, {0, 0, 1}, {0, 0, 1}}));
  EXPECT_TRUE(shape({1, 0, 0}).mesh.normals.empty());
  EXPECT_EQ(shape({1, 0, 0}).notes.front(), "1 normals for 3 vertices were left out");
}

TEST_F(Formats, UniRigsFolderNamesTheSample) {
  test::write_rig_npz(folder_ / "sample" / "raw_data.npz", rig_);
  const auto source = open_source(folder_ / "sample" / "raw_data.npz");
  EXPECT_EQ(source->ids(), std::vector<std::string>{"sample"});
  EXPECT_TRUE(source->is_single_file());
}

TEST_F(Formats, PublishedDataSet) {
  RigFile rig;
  rig.skin[0] = 0;  // a vertex without weights
  rig.skin[1] = 0;
  rig.skin[9] = 1.5f;  // and one whose weights do not sum to 1
  test::write_rig_npz(folder_ / "skeleton" / "sample" / "skeleton_voxelized.npz", rig);
  write_file_atomically(folder_ / "metadata.csv",
                        "sha256,local_path,is_bad_skin,source\nsample,raw/cat.glb,True,procedural:cat\n"
                        "lost,raw/dog.glb,False,real\n");
  const auto source = open_source(folder_.path());
  EXPECT_EQ(source->ids(), (std::vector<std::string>{"sample", "lost"}));
  EXPECT_EQ(source->other_names("sample"), (std::vector<std::string>{"raw/cat.glb"}));
  EXPECT_EQ(source->category("sample"), "cat");
  EXPECT_EQ(source->category("lost"), "");
  const RiggedShape shape = source->read("sample");
  rig.skin[0] = 1;
  rig.skin[9] = 0.75f;
  rig.skin[10] = 0.25f;
  expect_plain_rig(shape, false, rig.skin);
  EXPECT_EQ(shape.notes, (std::vector<std::string>{"1 vertices without a weight are bound to joint 0",
                                                   "1 vertices' weights did not sum to 1 and were divided by their sum",
                                                   "the data set marks its skin as bad"}));
  EXPECT_EQ(shape.not_whole, (std::vector<std::size_t>{0, 3}));
  EXPECT_EQ(test::refusal([&] { source->read("lost"); }), "there is no such file");
  EXPECT_EQ(test::refusal([&] { source->read("other"); }), "has no id \"other\"");
}

TEST_F(Formats, ArticulationXl) {
  RigFile other;
  other.uuid = "other";
  other.joints[4] = 7;
  RigFile damaged;
  damaged.uuid = "damaged";
  damaged.faces[0] = 99;
  for (const char* suffix : {"", "s"}) {
    test::write_articulation_xl(folder_ / "xl.npz", {rig_, damaged, other}, {suffix, true, true});
    const auto source = open_source(folder_ / "xl.npz");
    EXPECT_EQ(source->ids(), (std::vector<std::string>{"sample", "damaged", "other"}));
    const RiggedShape shape = source->read("sample");
    expect_plain_rig(shape, false, rig_.skin);
    EXPECT_EQ(shape.joint_names, (std::vector<std::string>{"j0", "j1", "j2"}));
    EXPECT_EQ(source->read("other").joints.positions[1].y(), 7.0);
    EXPECT_EQ(test::refusal([&] { source->read("damaged"); }), "sample damaged, faces[0]: names vertex 99 of 6");
    EXPECT_EQ(test::refusal([&] { source->read("none"); }), "has no sample \"none\"");
    EXPECT_EQ(source->describe(), "Articulation-XL file " + (folder_ / "xl.npz").string() + ": 3 samples");
  }
  test::write_articulation_xl(folder_ / "xl.npz", {rig_, rig_});
  EXPECT_EQ(test::refusal([&] { open_source(folder_ / "xl.npz"); }), "sample 1: the uuid sample appears twice");
}

TEST_F(Formats, ArticulationXlRefusesTwoParentsAndOddSkins) {
  const auto dictionary = [](const std::vector<std::pair<std::string, NdArray>>& arrays) {
    NpzValue sample;
    sample.kind = NpzValue::Kind::kDict;
    for (const auto& [key, array] : arrays) {
      sample.keys.push_back(key);
      sample.items.emplace_back();
      sample.items.back().kind = NpzValue::Kind::kArray;
      sample.items.back().array = array;
    }
    return sample;
  };
  const NdArray joints = NdArray::from(rig_.joints, {3, 3}), vertices = NdArray::from(rig_.vertices, {6, 3});
  const NdArray bones = NdArray::from<std::int64_t>({0, 2, 1, 2}, {2, 2});
  const NdArray weights = NdArray::from<double>({1, 1}, {2}), one = NdArray::from<std::int32_t>({0}, {1});
  const NdArray both = NdArray::from<std::int32_t>({0, 1}, {2});
  const auto problem = [&](const std::vector<std::pair<std::string, NdArray>>& arrays) {
    return test::refusal([&] { shape_from_articulation_xl(dictionary(arrays), "x", "f"); });
  };
  EXPECT_EQ(problem({{"joints", joints}, {"bones", bones}}), "bones[1]: joint 2 already has the parent 0");
  EXPECT_EQ(problem({{"joints", joints}, {"root_index", one}, {"bones", NdArray::from<std::int64_t>({0, 3}, {1, 2})}}),
            "bones[0]: names joint 3 of 3");
  EXPECT_EQ(problem({{"vertices", vertices},
                     {"joints", joints},
                     {"skinning_weights_value", weights},
                     {"skinning_weights_row", one},
                     {"skinning_weights_col", both}}),
            "skinning_weights_row: its shape is [1], expected [2]");
  EXPECT_EQ(problem({{"vertices", vertices},
                     {"joints", joints},
                     {"skinning_weights_value", weights},
                     {"skinning_weights_rows", both}}),
            "skinning_weights_col: the array is missing");
  EXPECT_EQ(problem({{"vertices", vertices},
                     {"joints", joints},
                     {"skinning_weights_value", weights},
                     {"skinning_weights_row", NdArray::from<std::int32_t>({0, 6}, {2})},
                     {"skinning_weights_col", both}}),
            "skinning_weights_value[1]: weights vertex 6 of 6");
}

TEST_F(Formats, TextRigIsYUpUnlessToldOtherwise) {
  test::write_text_rig(folder_ / "sample.txt", rig_);
  const RiggedShape shape = read(folder_ / "sample.txt");
  expect_plain_rig(shape, true, rig_.skin);
  EXPECT_EQ(shape.joint_names[2], "j2");
  expect_plain_rig(read(folder_ / "sample.txt", Axes::kZUp), false, rig_.skin);
}

TEST_F(Formats, TextRigKeepsVertexNumbersOfAnObjWithSeams) {
  test::write_text_rig(folder_ / "sample.txt", rig_);
  std::string obj;
  for (int i = 0; i < 12; ++i) obj += "vt " + std::to_string(i / 12.0) + " 0\n";
  obj += test::obj_text(rig_);
  obj = obj.substr(0, obj.find("f 1")) + "f 1/1 2/2 4/3\nf 1/4 4/5 3/6\nf 3/7 4/8 6/9\nf 3/10 6/11 5/12\n";
  test::write_quickly(folder_ / "sample.obj", obj);
  expect_plain_rig(read(folder_ / "sample.txt"), true, rig_.skin);
}

TEST_F(Formats, TextRigFindsItsMesh) {
  test::write_text_rig(folder_ / "sample.txt", rig_);
  const fs::path obj = folder_ / "sample.obj";
  fs::create_directories(folder_ / "rig_info_remesh");
  fs::create_directories(folder_ / "obj_remesh");
  fs::copy(folder_ / "sample.txt", folder_ / "sample_rig.txt");
  fs::copy(folder_ / "sample.txt", folder_ / "rig_info_remesh" / "sample.txt");
  fs::copy(obj, folder_ / "obj_remesh" / "sample.obj");
  EXPECT_EQ(mesh_of_text_rig(folder_ / "sample_rig.txt"), obj);
  EXPECT_EQ(read(folder_ / "rig_info_remesh" / "sample.txt").mesh.vertices.size(), 6u);
  fs::remove(obj);
  const RiggedShape alone = read(folder_ / "sample.txt");
  EXPECT_EQ(alone.joints.size(), 3u);
  EXPECT_FALSE(alone.has_skin());
  EXPECT_EQ(alone.notes.front(), "there is no sample.obj with its mesh");
}

TEST_F(Formats, AnymateGivesBoneWeightsToTheJointAtTheHead) {
  const RigFile rig = test::per_bone(rig_);
  RigFile second = rig;
  second.uuid = "00/second";
  test::write_anymate(folder_ / "list.pt", {rig, second});
  const auto source = open_source(folder_ / "list.pt");
  EXPECT_EQ(source->ids(), (std::vector<std::string>{"sample", "00/second"}));
  const RiggedShape shape = source->read("sample");
  expect_plain_rig(shape, true, rig.skin);
  ASSERT_EQ(shape.mesh.normals.size(), 6u);
  EXPECT_EQ(shape.mesh.normals[0], Eigen::Vector3f(0, -1, 0));  // (0, 0, 2) in the file
  EXPECT_EQ(source->read("00/second").id, "00/second");
}

TEST_F(Formats, AnymateWithoutFacesIsAPointSet) {
  test::write_anymate(folder_ / "list.pt", {test::per_bone(rig_)}, false);
  const RiggedShape shape = read(folder_ / "list.pt");
  EXPECT_FALSE(shape.has_surface());
  EXPECT_TRUE(shape.has_skin());
  EXPECT_EQ(shape.notes, std::vector<std::string>{"no faces: the mesh is a point set"});
}

TEST_F(Formats, AnymateSkeletonFromWhatIsThere) {
  const NdArray joints = NdArray::from<float>({0, 0, 0, 0, 1, 0, 1, 1, 0, -1, 1, 0, -3, -3, -3}, {5, 3});
  const NdArray bones = NdArray::from<float>({0, 0, 0, 0, 1, 0, 0, 1, 0, 1, 1, 0, 0, 1, 0, -1, 1, 0}, {3, 6});
  const NdArray conns = NdArray::from<std::int64_t>({0, 0, 1, 1}, {4});
  NdArray dense = NdArray::from(std::vector<float>(25, 0.0f), {5, 5});
  auto* cells = reinterpret_cast<float*>(dense.bytes.data());
  for (const int cell : {0, 5, 11, 16}) cells[cell] = 0.5f;
  const NdArray four = NdArray::from<std::int64_t>({4}, {});
  const std::vector<int> parents = {-1, 0, 1, 1};
  const auto skeleton = [](const NamedArrays& sample) { return shape_from_anymate(sample, "x", "f").joints; };
  EXPECT_EQ(skeleton({{"joints", joints}, {"joints_num", four}, {"conns", conns}, {"bones", bones}}).parents, parents);
  EXPECT_EQ(skeleton({{"joints", joints}, {"joints_num", four}, {"conns", dense}}).parents, parents);
  EXPECT_EQ(skeleton({{"joints", joints}, {"joints_num", four}, {"bones", bones}}).parents, parents);
  const anigen::JointTree ends = skeleton({{"bones", bones}});  // heads first, then tails
  EXPECT_EQ(ends.parents, parents);
  EXPECT_EQ(ends.positions[3], Eigen::Vector3d(-1, 1, 0));
  const auto problem = [](const NamedArrays& sample) {
    return test::refusal([&] { shape_from_anymate(sample, "x", "f"); });
  };
  EXPECT_EQ(problem({{"joints", joints}, {"conns", conns}}), "conns: 4 parents for 5 joints");
  EXPECT_EQ(problem({{"joints", NdArray::from<float>({5, 5, 5}, {1, 3})}, {"bones", bones}}),
            "bones[0]: its head is no joint");
  EXPECT_EQ(problem({{"joints", joints}, {"joints_num", NdArray::from<std::int64_t>({6}, {})}}),
            "joints_num: 6 of 5 rows in joints");
}

TEST_F(Formats, AnymateSampleOfThePublishedCollator) {
  const fs::path file = test::parity_file("ops_anymate_collate.safetensors");
  if (!fs::exists(file)) {
    GTEST_SKIP() << file << " is missing";
  }
  const NamedArrays tensors = read_safetensors(file).tensors;
  for (const std::string prefix : {"in.s0.", "in.s1."}) {
    NamedArrays sample;
    for (const auto& [name, array] : tensors) {
      if (name.compare(0, prefix.size(), prefix) == 0) sample.emplace_back(name.substr(prefix.size()), array);
    }
    sample.emplace_back("pc", NdArray::from(std::vector<float>(8192 * 6, 0.5f), {8192, 6}));
    const RiggedShape shape = shape_from_anymate(sample, "x", "f");
    EXPECT_TRUE(shape.has_skin());
    EXPECT_EQ(shape.joints.size(), static_cast<std::size_t>(find(sample, "joints")->shape[0]));
    EXPECT_EQ(shape.joints.size(), find(sample, "bones")->shape[0] + anigen::roots(shape.joints).size());
  }
}

TEST_F(Formats, GltfIsTurnedByItsImport) {
  test::write_glb(folder_ / "sample.glb", rig_);
  expect_plain_rig(read(folder_ / "sample.glb"), false, rig_.skin);
  const RiggedShape z_up = read(folder_ / "sample.glb", Axes::kZUp);
  EXPECT_LT((z_up.joints.positions[2] - Eigen::Vector3d(0, 1, 0)).norm(), 1e-6);  // its numbers as the file has them
}

TEST_F(Formats, SeveralThreadsReadAtOnce) {
  std::vector<RigFile> rigs;
  for (int i = 0; i < 20; ++i) {
    rigs.push_back(test::per_bone(rig_));
    rigs.back().uuid = std::to_string(i);
    rigs.back().joints[7] = i;
  }
  test::write_anymate(folder_ / "list.pt", rigs);
  test::write_articulation_xl(folder_ / "list.npz", rigs);
  for (const char* file : {"list.pt", "list.npz"}) {
    const auto source = open_source(folder_ / file, {Axes::kZUp});
    std::atomic<int> right{0};
    std::vector<std::thread> threads;
    for (int t = 0; t < 4; ++t) {
      threads.emplace_back([&source, &right, t] {
        for (int i = t % 2; i < 20; i += 2) {
          if (source->read(std::to_string(i)).joints.positions[2].y() == i) ++right;
        }
      });
    }
    for (std::thread& thread : threads) thread.join();
    EXPECT_EQ(right, 40);
  }
}

TEST_F(Formats, DataSetsKeepEveryNameOfAnAsset) {
  write_file_atomically(folder_ / "metadata.csv",
                        "sha256,file_identifier,local_path,uuid,variant_of\n"
                        "1,in/xl.npz#u-1,xl.npz#u-1,u-1,\n"
                        "2,in/xl.npz#u-1,xl.npz#u-1,u-1,1\n");
  const std::vector<DatasetItem> items = list_dataset(folder_.path());
  EXPECT_EQ(items[0].uuid, "u-1");
  EXPECT_EQ(items[0].other_names, (std::vector<std::string>{"u-1", "xl.npz#u-1", "in/xl.npz#u-1"}));
  EXPECT_TRUE(items[1].other_names.empty()) << "a posed variant is another shape";
  // Tables from before there was a column for it say it in the path.
  write_file_atomically(folder_ / "metadata.csv", "sha256,local_path\n1,xl.npz#u-1\n2,raw/cat#1.glb\n");
  EXPECT_EQ(list_dataset(folder_.path())[0].uuid, "u-1");
  EXPECT_EQ(list_dataset(folder_.path())[1].uuid, "");
}

}  // namespace

namespace {

namespace fs = std::filesystem;
using test::RigFile;

class Rigs : public testing::Test {
 protected:
  /// One rig in every format, in a folder with files that are none.
  void write_all() {
    test::write_glb(folder_ / "in/a.glb", rig_);
    write_file_atomically(folder_ / "in/b.dae", test::collada_text(rig_));
    write_file_atomically(folder_ / "in/c.FBX", test::fbx_text(rig_));
    test::write_text_rig(folder_ / "in/d/d.txt", rig_);
    write_file_atomically(folder_ / "in/d/notes.txt", "notes\n");
    test::write_rig_npz(folder_ / "in/e/raw_data.npz", rig_);
    RigFile other = rig_;
    other.uuid = "other";
    other.vertices[0] = -0.2f;
    test::write_articulation_xl(folder_ / "in/f_test.npz", {rig_, other});
    test::write_anymate(folder_ / "in/g.pt", {test::per_bone(rig_)});
  }

  test::TemporaryFolder folder_;
  RigFile rig_;
};

TEST_F(Rigs, AreListedFromMixedFolders) {
  write_all();
  std::string listed;
  for (const RigEntry& entry : list_rigs(folder_ / "in"))
    listed += std::string(name_of(entry.format)) + " " + entry.local_path + (entry.is_test ? " test\n" : "\n");
  EXPECT_EQ(listed,
            "gltf a.glb\nassimp b.dae\nassimp c.FBX\ntext_rig d/d.txt\nrig_arrays e/raw_data.npz\n"
            "articulation_xl f_test.npz#sample test\narticulation_xl f_test.npz#other test\nanymate g.pt#sample\n");
  EXPECT_EQ(list_rigs(folder_ / "in/g.pt").at(0).key, "sample");
  for (const RigFormat format : {RigFormat::kGltf, RigFormat::kDataset})
    EXPECT_EQ(parse_rig_format(name_of(format)), format);
  EXPECT_THROW(parse_rig_format("obj"), InputError);
}

TEST_F(Rigs, OfEveryFormatAreReadAsAssets) {
  write_all();
  const RigReader reader;
  for (const RigEntry& entry : list_rigs(folder_ / "in")) {
    const ImportedAsset imported = reader.read(entry);
    EXPECT_TRUE(validate(imported.asset).empty()) << entry.local_path;
    EXPECT_EQ(imported.asset.skeleton.size(), 3u) << entry.local_path;
    EXPECT_EQ(imported.asset.mesh.faces.size(), 4u) << entry.local_path;
    EXPECT_EQ(imported.asset.skin.rows(), imported.asset.mesh.vertices.size()) << entry.local_path;
  }
}

TEST_F(Rigs, KeepTheirNamesWhereTheseAreUnique) {
  test::write_text_rig(folder_ / "in/d.txt", rig_);
  EXPECT_EQ(RigReader().read(list_rigs(folder_ / "in").at(0)).asset.skeleton.names,
            (std::vector<std::string>{"j0", "j1", "j2"}));
}

TEST_F(Rigs, AreCalledByTheirContentWhereverItLies) {
  RigFile other = rig_, third = rig_;
  other.uuid = "other";
  other.joints[2] = 0.125;
  third.uuid = "third";
  third.vertices[1] = 0.25f;
  test::write_articulation_xl(folder_ / "one/all.npz", {rig_, other, third});
  test::write_articulation_xl(folder_ / "two/a.npz", {other});
  test::write_articulation_xl(folder_ / "two/b.npz", {third, rig_});
  const auto ids = [](const fs::path& folder) {
    const RigReader reader;
    std::map<std::string, std::string> ids;
    for (const RigEntry& entry : list_rigs(folder)) ids[entry.key] = reader.content_id(entry);
    return ids;
  };
  const auto one = ids(folder_ / "one");
  EXPECT_EQ(one, ids(folder_ / "two"));
  EXPECT_EQ(one.at("sample").size(), 64u);
  EXPECT_NE(one.at("sample"), one.at("other"));
  EXPECT_NE(one.at("sample"), one.at("third"));

  test::write_anymate(folder_ / "three/a.pt", {test::per_bone(rig_)});
  test::write_anymate(folder_ / "four/b.pt", {test::per_bone(other), test::per_bone(rig_)});
  EXPECT_EQ(ids(folder_ / "three").at("sample"), ids(folder_ / "four").at("sample"));
  EXPECT_NE(ids(folder_ / "four").at("other"), ids(folder_ / "four").at("sample"));
}

TEST_F(Rigs, TextRigsFollowTheirMesh) {
  test::write_text_rig(folder_ / "in/a.txt", rig_);
  const RigEntry entry = list_rigs(folder_ / "in").at(0);
  const std::string before = RigReader().content_id(entry);
  rig_.vertices[0] = -0.3f;
  write_file_atomically(folder_ / "in/a.obj", test::obj_text(rig_));
  EXPECT_NE(RigReader().content_id(entry), before);
}

TEST_F(Rigs, OfDatasetsCarryTheirFlags) {
  test::write_rig_npz(folder_ / "skeleton/x/skeleton_voxelized.npz", rig_);
  test::write_rig_npz(folder_ / "skeleton/y/skeleton_voxelized.npz", rig_);
  write_file_atomically(folder_ / "metadata.csv", "sha256,local_path,is_test\nx,cat.glb,True\ny,,False\n");
  write_file_atomically(folder_ / "ignored.glb", "not looked at");
  const std::vector<RigEntry> entries = list_rigs(folder_.path());
  ASSERT_EQ(entries.size(), 2u);
  EXPECT_EQ(entries[0].key, "x");
  EXPECT_EQ(entries[0].local_path, "cat.glb");
  EXPECT_TRUE(entries[0].is_test);
  EXPECT_FALSE(entries[1].is_test);
  EXPECT_EQ(RigReader().read(entries[1]).asset.skeleton.size(), 3u);
  EXPECT_EQ(RigReader().content_id(entries[0]), RigReader().content_id(entries[1])) << "one content";
}

TEST_F(Rigs, WithMissingPartsAreNoAssets) {
  rig_.has_skin = false;
  test::write_rig_npz(folder_ / "in/a.npz", rig_);
  const auto read = [&] { RigReader().read(list_rigs(folder_ / "in").at(0)); };
  EXPECT_NE(test::refusal(read).find("has no skin weights"), std::string::npos);
  rig_.has_skin = true;
  rig_.faces.clear();
  test::write_rig_npz(folder_ / "in/a.npz", rig_);
  EXPECT_NE(test::refusal(read).find("has no mesh with faces"), std::string::npos);
}

TEST_F(Rigs, TellWhatWasMissingInTheirWeights) {
  rig_.skin[0] = 0;    // vertex 0 has none
  rig_.skin[3] = 0.5;  // vertex 1 has half
  test::write_rig_npz(folder_ / "in/a.npz", rig_);
  const ImportedAsset imported = RigReader().read(list_rigs(folder_ / "in").at(0));
  EXPECT_NEAR(imported.lowest_weight_sum, 0.5, 1e-6);
  ASSERT_FALSE(imported.notes.empty());
  EXPECT_EQ(imported.notes[0].code, "zero_weights");
  EXPECT_EQ(imported.notes[0].message.substr(0, 2), "1 ");
}

TEST_F(Rigs, RefusalsNameTheirFile) {
  EXPECT_EQ(test::refusal([&] { list_rigs(folder_ / "absent"); }), "no such file or folder");
  fs::create_directories(folder_ / "empty");
  EXPECT_NE(test::refusal([&] { list_rigs(folder_ / "empty"); }).find("holds no rigged asset"), std::string::npos);
  write_file_atomically(folder_ / "a.txt", "notes\n");
  EXPECT_NE(test::refusal([&] { list_rigs(folder_ / "a.txt"); }).find("is no text rig"), std::string::npos);
  write_file_atomically(folder_ / "a.blend", "x");
  EXPECT_NE(test::refusal([&] { list_rigs(folder_ / "a.blend"); }).find("expected a folder"), std::string::npos);
  write_file_atomically(folder_ / "bad/a.npz", "not an archive");
  EXPECT_THROW(list_rigs(folder_ / "bad/a.npz"), InputError);
  // In a folder it stands for itself, so that it fails alone and by name.
  const std::vector<RigEntry> entries = list_rigs(folder_ / "bad");
  ASSERT_EQ(entries.size(), 1u);
  EXPECT_EQ(entries[0].local_path, "a.npz");
  EXPECT_THROW(RigReader().read(entries[0]), InputError);
  EXPECT_THROW(RigReader().content_id(entries[0]), InputError);
}

}  // namespace

}  // namespace anigen::io
