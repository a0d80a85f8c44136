#include "anigen/io/rigs/shard_writer.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/arrays/npz_samples.h"
#include "anigen/io/arrays/zip_stream.h"
#include "anigen/io/rigs/anymate.h"
#include "tests/io/arrays/array_file_bytes.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::io {
namespace {

namespace fs = std::filesystem;

/// Two quads along a chain of three joints whose last one has weights, too, and a second child of the root.
RiggedShape branching() {
  const test::TemporaryFolder folder;
  test::write_articulation_xl(folder / "x.npz", {test::RigFile()});
  RiggedShape shape = open_source(folder / "x.npz")->read("sample");
  shape.joints.positions.emplace_back(0.1, -0.3, 0.2);
  shape.joints.parents.push_back(0);
  shape.joint_names.emplace_back("twig");
  return shape;
}

class WrittenShards : public testing::Test {
 protected:
  void write(const fs::path& file, const std::vector<RiggedShape>& shapes) const {
    const auto writer = open_shard_writer(file, shapes.size());
    for (std::size_t i = 0; i < shapes.size(); ++i) writer->add(shapes[i], "name-" + std::to_string(i));
    writer->finish();
  }
  test::TemporaryFolder folder_;
};

/// Position in the box of side 1 around the mesh.
Eigen::Vector3d in_box(const RiggedShape& shape, const Eigen::Vector3d& place) {
  Eigen::Vector3f low = shape.mesh.vertices.front(), high = low;
  for (const Eigen::Vector3f& vertex : shape.mesh.vertices) {
    low = low.cwiseMin(vertex);
    high = high.cwiseMax(vertex);
  }
  return (place - 0.5 * (low + high).cast<double>()) / double{(high - low).maxCoeff()};
}

void expect_same_mesh_and_weights(const RiggedShape& read, const RiggedShape& shape, double weight_error) {
  ASSERT_EQ(read.mesh.vertices.size(), shape.mesh.vertices.size());
  EXPECT_EQ(read.mesh.faces, shape.mesh.faces);
  for (std::size_t v = 0; v < shape.mesh.vertices.size(); ++v) {
    EXPECT_LT(
        (in_box(read, read.mesh.vertices[v].cast<double>()) - in_box(shape, shape.mesh.vertices[v].cast<double>()))
            .norm(),
        1e-6);
  }
  ASSERT_GE(read.joints.size(), shape.joints.size());
  for (std::size_t j = 0; j < shape.joints.size(); ++j) {
    EXPECT_LT((in_box(read, read.joints.positions[j]) - in_box(shape, shape.joints.positions[j])).norm(), 1e-6);
  }
  ASSERT_TRUE(read.has_skin());
  const std::vector<float> expected = to_dense(shape.skin, read.joints.size()),
                           found = to_dense(read.skin, read.joints.size());
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(found[i], expected[i], weight_error) << i;
}

TEST_F(WrittenShards, ArticulationXlIsReadBack) {
  const RiggedShape shape = branching();
  write(folder_ / "s.npz", {shape, shape});
  EXPECT_NE(NpzSamples::open(folder_ / "s.npz", "uuid"), nullptr) << "each can be read without the others";
  const auto source = open_source(folder_ / "s.npz");
  EXPECT_EQ(source->ids(), (std::vector<std::string>{"name-0", "name-1"}));
  const RiggedShape read = source->read("name-1");
  expect_same_mesh_and_weights(read, shape, 1e-6);
  EXPECT_EQ(read.joints.parents, shape.joints.parents);
  EXPECT_EQ(read.joint_names, shape.joint_names);
}

TEST_F(WrittenShards, AnymateIsReadBackWithTheTailsOfItsBones) {
  const RiggedShape shape = branching();
  write(folder_ / "s.pt", {shape});
  const RiggedShape read = open_source(folder_ / "s.pt")->read("name-0");
  expect_same_mesh_and_weights(read, shape, 1e-3);  // half precision
  // Tails: of the root, which has two children, and of the two leaves.
  ASSERT_EQ(read.joints.size(), shape.joints.size() + 3);
  for (std::size_t j = 0; j < shape.joints.size(); ++j) {
    int above = read.joints.parents[j];
    if (above >= static_cast<int>(shape.joints.size())) above = read.joints.parents[static_cast<std::size_t>(above)];
    EXPECT_EQ(above, shape.joints.parents[j]) << j;
  }
  const AnymateArchive archive(folder_ / "s.pt");
  const NamedArrays sample = archive.sample(0);
  for (const char* key : {"pc", "vox", "bones", "bones_num", "joints", "joints_num", "conns", "skins_index",
                          "skins_weight", "mesh_skins_index", "mesh_skins_weight", "mesh_pc", "mesh_face"})
    EXPECT_NE(find(sample, key), nullptr) << key;
  EXPECT_EQ(find(sample, "pc")->shape, (std::vector<std::int64_t>{8192, 6}));
  EXPECT_EQ(find(sample, "conns")->dtype, Dtype::kI8);
  EXPECT_EQ(find(sample, "skins_weight")->dtype, Dtype::kF16);
  for (const float x : find(sample, "pc")->as<float>()) EXPECT_LE(std::abs(x), 1.0001f);
}

TEST_F(WrittenShards, EqualShapesGiveEqualBytes) {
  for (const char* extension : {".npz", ".pt"}) {
    write(folder_ / ("a" + std::string(extension)), {branching()});
    write(folder_ / ("b" + std::string(extension)), {branching()});
    EXPECT_EQ(read_file(folder_ / ("a" + std::string(extension)), 1 << 24),
              read_file(folder_ / ("b" + std::string(extension)), 1 << 24));
  }
}

TEST_F(WrittenShards, RefuseWhatTheyCannotHold) {
  EXPECT_THROW(open_shard_writer(folder_ / "s.zip", 1), NotSupportedError);
  RiggedShape bare = branching();
  bare.skin = {};
  RiggedShape twin = branching();
  twin.joints.positions[3] = twin.joints.positions[2];
  for (const char* file : {"s.npz", "s.pt"}) {
    const auto writer = open_shard_writer(folder_ / file, 1);
    EXPECT_THROW(writer->add(bare, "bare"), InputError);
    EXPECT_THROW(writer->finish(), Error) << "one was announced";
    EXPECT_FALSE(fs::exists(folder_ / file));
  }
  EXPECT_THROW(anymate_sample(twin), InputError);
}

TEST_F(WrittenShards, ArchivesOfManyMembersAreRead) {
  constexpr std::size_t kMembers = 70'000;  // more than a directory without zip64 can count
  {
    ZipStream zip(folder_ / "many.zip");
    for (std::size_t i = 0; i < kMembers; ++i) {
      zip.begin("m" + std::to_string(i), i % 2 == 0);
      zip.write("content " + std::to_string(i));
    }
    zip.commit();
  }
  const ZipReader archive(folder_ / "many.zip");
  ASSERT_EQ(archive.members().size(), kMembers);
  for (const std::size_t i : {0u, 1u, 65'536u, 69'999u})
    EXPECT_EQ(archive.read(*archive.find("m" + std::to_string(i))), "content " + std::to_string(i));
}

}  // namespace
}  // namespace anigen::io
