#include <gtest/gtest.h>
#include <set>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/core/random.h"
#include "anigen/prepare/metadata.h"
#include "anigen/prepare/prepare_source.h"
#include "anigen/prepare/sources.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"
#include "tests/support/scene_files.h"

namespace anigen::prepare {

namespace {

TEST(AssetSource, SurvivesJson) {
  AssetSource source;
  source.format = io::RigFormat::kArticulationXl;
  source.file = "/data/xl test.npz";
  source.key = "uuid-1";
  source.local_path = "xl test.npz#uuid-1";
  source.uuid = "uuid-1";
  source.file_identifier = "data/xl test.npz#uuid-1";
  source.is_test = true;
  const AssetSource again = parse_json(Json(source).dump(), "memory").get<AssetSource>();
  EXPECT_EQ(again.format, source.format);
  EXPECT_EQ(again.file, source.file);
  EXPECT_EQ(again.key, source.key);
  EXPECT_EQ(again.local_path, source.local_path);
  EXPECT_EQ(again.uuid, source.uuid);
  EXPECT_EQ(again.source_path(), "xl test.npz");
  EXPECT_EQ(again.file_identifier, source.file_identifier);
  EXPECT_TRUE(again.is_test);
  const AssetSource creature = Json(procedural_sources(7, 3)[2]).get<AssetSource>();
  EXPECT_TRUE(creature.procedural());
  EXPECT_EQ(creature.seed, 7u);
  EXPECT_EQ(creature.index, 2u);
  EXPECT_EQ(asset_id(creature), asset_id(procedural_sources(7, 3)[2]));
}

TEST(AssetSource, DamagedJsonIsRefused) {
  Json json(procedural_sources(7, 1)[0]);
  json.erase("seed");
  EXPECT_THROW(json.get<AssetSource>(), InputError);
  EXPECT_THROW(Json::array().get<AssetSource>(), InputError);
  EXPECT_THROW(Json({{"format", "gltf"}, {"file_identifier", "x"}, {"file", ""}}).get<AssetSource>(), InputError);
  EXPECT_THROW(Json({{"format", "stl"}, {"file_identifier", "x"}}).get<AssetSource>(), InputError);
}

TEST(AssetSource, EveryFormatIsFoundNamedAndImported) {
  const test::TemporaryFolder folder;
  test::RigFile rig;
  test::write_glb(folder / "in/a.glb", rig);
  write_file_atomically(folder / "in/b.dae", test::collada_text(rig));
  write_file_atomically(folder / "in/c.fbx", test::fbx_text(rig));
  test::write_text_rig(folder / "in/d.txt", rig);
  test::write_articulation_xl(folder / "in/e.npz", {rig});
  test::write_anymate(folder / "in/f.pt", {test::per_bone(rig)});
  const std::vector<AssetSource> sources = find_assets({folder / "in/", folder / "in/b.dae"});
  ASSERT_EQ(sources.size(), 7u);
  EXPECT_EQ(sources[0].file_identifier, "in/a.glb");
  EXPECT_EQ(sources[4].file_identifier, "in/e.npz#sample");
  EXPECT_EQ(sources[6].file_identifier, "in/b.dae");
  const io::RigReader reader;
  EXPECT_EQ(asset_id(sources[0], reader), sha256(read_file(folder / "in/a.glb")));
  EXPECT_EQ(asset_id(sources[1], reader), asset_id(sources[6], reader));
  for (const AssetSource& source : sources) {
    const PreparedAsset prepared = import_asset(source, {}, reader);
    EXPECT_EQ(prepared.record.num_joints, 3u) << source.file_identifier;
    EXPECT_EQ(prepared.record.source, "real");
    EXPECT_NEAR(bounding_box(prepared.asset.mesh.vertices).longest_side(), 1.0, 1e-6) << source.file_identifier;
  }
}

TEST(AssetSource, PublishedDatasetsKeepTheirIds) {
  const test::TemporaryFolder folder;
  test::write_rig_npz(folder / "data/skeleton/some-id/skeleton_voxelized.npz", test::RigFile());
  write_file_atomically(folder / "data/metadata.csv", "sha256,is_test\nsome-id,True\n");
  const AssetSource source = find_assets({folder / "data"}).at(0);
  EXPECT_EQ(asset_id(source), "some-id");
  EXPECT_TRUE(source.is_test);
  EXPECT_EQ(import_asset(source).record.num_joints, 3u);
}

TEST(AssetRecord, SurvivesJson) {
  const PreparedAsset prepared = import_asset(procedural_sources(3, 1)[0]);
  AssetRecord record = prepared.record;
  record.lowest_weight_sum = 0.75;
  record.repeated_names = 2;
  record.findings = {{"unused_joints", "changed", "2 joints without weights pruned: a, b"}};
  const Json json = import_columns(record);
  EXPECT_EQ(import_columns(record_from_columns(json)), json);
  Json other = json;
  other["version"] = 1;
  EXPECT_THROW(record_from_columns(other), InputError);
}

}  // namespace

namespace {

TEST(ClosestBones, ComparesVectorsFromTheParentOfAllButTheRoot) {
  const std::vector<int> parents = {-1, 0, 0, 1};
  // Mirrored limbs differ; a root at the origin is not compared with a bone of no length.
  EXPECT_NEAR(closest_bones({{0, 0, 0}, {0, 0, 0}, {-0.1f, 0, 0}, {0.1f, 0, 0.2f}}, parents), 0.1, 1e-7);
  // Joint 3 repeats the vector of joint 1 elsewhere.
  EXPECT_NEAR(closest_bones({{0, 0, 0}, {0.1f, 0, 0}, {-0.1f, 0, 0}, {0.2f, 0, 0}}, parents), 0.0, 1e-7);
  EXPECT_EQ(closest_bones({{0, 0, 0}, {0.1f, 0, 0}}, {-1, 0}), kNoPair);
}

TEST(ClosestBones, AgreesWithComparingAllPairs) {
  Rng rng(1, "closest bones");
  std::vector<Eigen::Vector3f> joints(1, Eigen::Vector3f::Zero());
  std::vector<int> parents = {-1};
  for (int j = 1; j < 60; ++j) {
    parents.push_back(0);
    joints.emplace_back(0.01f * static_cast<float>(rng.index(4)), static_cast<float>(rng.uniform()),
                        static_cast<float>(rng.uniform()));
  }
  double expected = kNoPair;
  for (std::size_t a = 1; a < joints.size(); ++a) {
    for (std::size_t b = 1; b < a; ++b)
      expected = std::min(expected, static_cast<double>((joints[a] - joints[b]).cwiseAbs().maxCoeff()));
  }
  EXPECT_NEAR(closest_bones(joints, parents), expected, 1e-7);
}

TEST(Quality, FollowsTheLimits) {
  AssetRecord record;
  record.num_joints = 3;
  record.num_vertices = 1000;
  record.closest_bones = 2e-6;
  const QualityLimits limits;
  EXPECT_TRUE(usable(record, limits));
  record.num_joints = 2;
  EXPECT_FALSE(usable(record, limits));
  record.num_joints = 100;
  EXPECT_TRUE(usable(record, limits));
  record.num_joints = 101;
  EXPECT_FALSE(usable(record, limits));
  record.num_joints = 50;
  record.closest_bones = 1e-6;
  EXPECT_FALSE(usable(record, limits));

  record.invented_rows = 10;
  EXPECT_FALSE(bad_skin(record, limits));
  record.invented_rows = 11;
  EXPECT_TRUE(bad_skin(record, limits));
}

TEST(Quality, InventedRowsAreReadFromTheImportNotes) {
  EXPECT_EQ(invented_rows({{"nan_weights", "6 vertices had weights that are not numbers"},
                           {"unnormalised_weights", "100 vertices"},
                           {"zero_weights", "4 vertices had no weight"}}),
            10u);
}

TEST(StreamSources, DrawNoTestSeedAndNoCreatureTwice) {
  std::set<std::string> seen;
  for (const std::uint64_t seed : {std::uint64_t{0}, std::uint64_t{900'000'000}, creature_seeds::kFirstOfStreams - 1}) {
    for (const std::uint64_t shard : {0, 1, 7}) {
      for (const AssetSource& source : stream_sources(seed, shard, 5)) {
        EXPECT_FALSE(creature_seeds::is_test(source.seed));
        EXPECT_GE(source.seed, creature_seeds::kFirstOfStreams);
        EXPECT_TRUE(seen.insert(source.file_identifier).second) << source.file_identifier;
      }
    }
  }
  EXPECT_EQ(stream_sources(3, 2, 5).front().file_identifier, "procedural/1000000000003/10");
  EXPECT_THROW(stream_sources(creature_seeds::kFirstOfStreams, 0, 1), InputError);
}

}  // namespace

}  // namespace anigen::prepare
