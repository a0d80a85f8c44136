#include "anigen/prepare/dataset.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <future>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <thread>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/parallel.h"
#include "anigen/core/process.h"
#include "anigen/core/random.h"
#include "anigen/core/run_folder.h"
#include "anigen/core/table.h"
#include "anigen/creatures/body.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/image.h"
#include "anigen/prepare/run.h"
#include "anigen/prepare/steps.h"
#include "tests/support/dataset_files.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::prepare {
namespace {

namespace fs = std::filesystem;

/// A tetrahedron on a chain of joints.
Asset small_asset(std::size_t joints, float width) {
  Asset asset;
  asset.name = "small";
  asset.mesh.vertices = {{0, 0, 0}, {width, 0, 0}, {0, 1, 0}, {0, 0, 2}};
  asset.mesh.faces = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
  std::vector<Eigen::Vector3d> positions;
  std::vector<int> parents;
  for (std::size_t j = 0; j < joints; ++j) {
    positions.emplace_back(0.01 * static_cast<double>(j * j), 0.0, 0.1 * static_cast<double>(j));
    parents.push_back(static_cast<int>(j) - 1);
  }
  asset.skeleton = skeleton_from_joints(positions, parents);
  asset.skin.append_row({{0, 1.0f}});
  asset.skin.append_row({{0, 0.5f}, {1, 0.5f}});
  asset.skin.append_row({{1, 1.0f}});
  asset.skin.append_row({{1, 0.25f}, {0, 0.75f}});
  return asset;
}

class PrepareDataset : public testing::Test {
 protected:
  PrepareDataset() {
    io::write_gltf(input() / "b" / "chain.glb", small_asset(5, 1.0f));
    io::write_gltf(input() / "a.glb", small_asset(4, 1.5f));
    io::write_gltf(input() / "two joints.glb", small_asset(2, 1.0f));
    fs::create_directories(input() / "z");
    fs::copy_file(input() / "a.glb", input() / "z" / "copy.GLB");
    const std::string whole = read_file(input() / "a.glb");
    write_file_atomically(input() / "z" / "truncated.glb", whole.substr(0, whole.size() / 2));
    write_file_atomically(input() / "z" / "notes.txt", "not an asset");
    write_file_atomically(input() / "z" / "wrong.gltf", "{\"buffers\": [{\"uri\": \"../../secret\"}]}");
  }

  fs::path input() const { return folder_ / "input"; }

  PrepareOptions options(const std::string& out) const {
    PrepareOptions options;
    options.out = folder_ / out;
    options.sources = find_assets({input()});
    options.tables.split.seed = 3;
    options.tables.split.test_count = 1;
    return options;
  }

  test::TemporaryFolder folder_;
};

// Another body on the skeleton of b/chain.glb.
TEST_F(PrepareDataset, NearSkeletonsAreFlaggedOrDropped) {
  io::write_gltf(input() / "c" / "wider.glb", small_asset(5, 1.3f));
  PrepareOptions wanted = options("near");
  prepare_dataset(wanted);
  const CsvTable flagged = read_csv(folder_ / "near" / "metadata.csv");
  ASSERT_EQ(flagged.rows.size(), 4u);
  EXPECT_EQ(flagged.cell(2, "local_path"), "c/wider.glb");
  EXPECT_EQ(flagged.cell(2, "near_skeleton_of"), flagged.cell(1, "sha256"));

  wanted.tables.near_skeletons = near_skeletons_of_preset("anymate");
  const PrepareSummary summary = prepare_dataset(wanted);
  EXPECT_EQ(read_csv(folder_ / "near" / "metadata.csv").rows.size(), 3u);
  ASSERT_EQ(summary.rejected.size(), 4u);
  EXPECT_TRUE(std::any_of(summary.rejected.begin(), summary.rejected.end(), [](const Rejected& one) {
    return one.file_identifier == "input/c/wider.glb" && one.rule == "near_duplicate_skeleton";
  }));
}

TEST_F(PrepareDataset, WritesThePublishedLayoutAndCountsWhatItRejects) {
  const PrepareSummary summary = prepare_dataset(options("out"));
  EXPECT_EQ(summary.real, 3u);
  EXPECT_EQ(summary.bad_skeleton, 1u);
  EXPECT_EQ(summary.train, 1u);
  EXPECT_EQ(summary.test, 1u);
  ASSERT_EQ(summary.rejected.size(), 3u);
  EXPECT_EQ(summary.rejected[0].file_identifier, "input/z/copy.GLB");
  EXPECT_NE(summary.rejected[0].reason.find("input/a.glb"), std::string::npos);
  EXPECT_EQ(summary.rejected[1].file_identifier, "input/z/truncated.glb");
  EXPECT_EQ(summary.rejected[2].file_identifier, "input/z/wrong.gltf");

  const CsvTable table = read_csv(folder_ / "out" / "metadata.csv");
  ASSERT_EQ(table.rows.size(), 3u);
  EXPECT_EQ(table.cell(0, "local_path"), "a.glb");
  EXPECT_EQ(table.cell(1, "local_path"), "b/chain.glb");
  EXPECT_EQ(table.cell(2, "local_path"), "two joints.glb");
  EXPECT_EQ(table.cell(0, "num_joints"), "4");
  EXPECT_EQ(table.cell(0, "max_influences"), "2");
  EXPECT_EQ(table.cell(0, "source"), "real");
  EXPECT_EQ(table.cell(2, "is_bad_skeleton"), "True");
  EXPECT_EQ(table.cell(2, "is_test"), "False");
  EXPECT_EQ(read_file(folder_ / "out" / "splits" / "unusable.txt"), table.cell(2, "sha256") + "\n");
  EXPECT_EQ(read_csv(folder_ / "out" / "rejected.csv").rows.size(), 3u);

  // The published columns, and the files that they speak of.
  for (const char* column : {"voxelized", "num_voxels", "rendered", "cond_rendered", "is_bad_skin"})
    EXPECT_NE(table.column(column), CsvTable::kMissing) << column;
  EXPECT_EQ(table.column("aesthetic_score"), CsvTable::kMissing);
  for (std::size_t row = 0; row < 3; ++row) {
    const AssetPlaces places{folder_ / "out", table.cell(row, "sha256")};
    EXPECT_TRUE(table.flag(row, "voxelized", false, ""));
    EXPECT_FALSE(table.flag(row, "rendered", true, ""));
    EXPECT_EQ(read_voxel_ply(places.surface_voxels(), 64).size(), std::stoul(table.cell(row, "num_voxels")));
    EXPECT_FALSE(read_voxel_ply(places.skeleton_voxels(), 64).empty());
  }
  const std::string card = read_file(folder_ / "out" / "card.html");
  EXPECT_NE(card.find("input/z/truncated.glb"), std::string::npos);
  EXPECT_NE(card.find("data:image/png;base64,"), std::string::npos);
  const std::string markdown = read_file(folder_ / "out" / "card.md");
  EXPECT_NE(markdown.find("| assets | 3 |"), std::string::npos);
  EXPECT_NE(markdown.find("| source | assets | category | animated | joints | bones | vertices |"), std::string::npos);
}

TEST_F(PrepareDataset, ArraysAreTheNormalisedAsset) {
  prepare_dataset(options("out"));
  const CsvTable table = read_csv(folder_ / "out" / "metadata.csv");
  const fs::path file = folder_ / "out" / "skeleton" / table.cell(0, "sha256") / "skeleton_voxelized.npz";
  const io::NamedArrays arrays = io::read_npz(file);
  Asset expected = io::read_gltf(input() / "a.glb").asset;
  normalize(expected);

  EXPECT_EQ(io::find(arrays, "joints")->dtype, io::Dtype::kF32);
  EXPECT_EQ(io::find(arrays, "parents")->dtype, io::Dtype::kI32);
  EXPECT_EQ(io::find(arrays, "faces")->dtype, io::Dtype::kI32);
  EXPECT_EQ(io::find(arrays, "skin")->shape, (std::vector<std::int64_t>{4, 4}));
  EXPECT_EQ(io::find(arrays, "parents")->as<std::int32_t>(), (std::vector<std::int32_t>{-1, 0, 1, 2}));
  EXPECT_EQ(io::find(arrays, "skin")->as<float>(), to_dense(expected.skin, 4));
  const std::vector<float> vertices = io::find(arrays, "vertices")->as<float>();
  const std::vector<float> joints = io::find(arrays, "joints")->as<float>();
  float low = 1, high = -1;
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    EXPECT_EQ(vertices[i], expected.mesh.vertices[i / 3][static_cast<Eigen::Index>(i % 3)]);
    low = std::min(low, vertices[i]);
    high = std::max(high, vertices[i]);
  }
  EXPECT_FLOAT_EQ(low, -0.5f);
  EXPECT_FLOAT_EQ(high, 0.5f);
  for (std::size_t i = 0; i < joints.size(); ++i)
    EXPECT_NEAR(joints[i], expected.skeleton.positions()[i / 3][static_cast<Eigen::Index>(i % 3)], 1e-6);
  // The kept asset is in the same frame.
  const Asset kept = io::read_gltf(folder_ / "out" / "assets" / (table.cell(0, "sha256") + ".glb")).asset;
  EXPECT_NEAR(bounding_box(kept.mesh.vertices).longest_side(), 1.0, 1e-6);
}

TEST_F(PrepareDataset, RepeatedCallsReuseAndAreByteIdentical) {
  prepare_dataset(options("out"));
  const auto before = test::dataset_files(folder_ / "out");
  const PrepareSummary again = prepare_dataset(options("out"));
  EXPECT_EQ(again.reused, 3u);
  EXPECT_EQ(test::dataset_files(folder_ / "out"), before);

  // Somewhere else, on one thread.
  const int threads = thread_count();
  set_thread_count(1);
  prepare_dataset(options("elsewhere"));
  set_thread_count(threads);
  EXPECT_EQ(test::dataset_files(folder_ / "elsewhere"), before);
}

TEST_F(PrepareDataset, KeepsTheColumnsOfOtherPrograms) {
  prepare_dataset(options("out"));
  const fs::path file = folder_ / "out" / "metadata.csv";
  const CsvTable own = read_csv(file);
  CsvTable table = own;
  table.columns.insert(table.columns.end(), {"ss_latent_a", "caption", "feature_gone"});
  for (auto& row : table.rows) row.insert(row.end(), {"True", "a chain, \"rigged\"", "True"});
  table.rows.erase(table.rows.begin() + 1);
  write_file_atomically(file, to_csv(table));

  prepare_dataset(options("out"));
  const CsvTable again = read_csv(file);
  ASSERT_EQ(again.rows.size(), own.rows.size());
  ASSERT_EQ(again.columns.size(), own.columns.size() + 2) << "features that are not there are not carried over";
  for (std::size_t row = 0; row < own.rows.size(); ++row) {
    EXPECT_EQ(again.cell(row, "ss_latent_a"), row == 1 ? "False" : "True") << "nobody made latents of a new asset";
    EXPECT_EQ(again.cell(row, "caption"), row == 1 ? "" : "a chain, \"rigged\"");
    EXPECT_EQ(std::vector<std::string>(again.rows[row].begin(), again.rows[row].end() - 2), own.rows[row]);
  }
  const std::string bytes = read_file(file);
  prepare_dataset(options("out"));
  EXPECT_EQ(read_file(file), bytes);
  write_file_atomically(file, "not, a\ntable");
  EXPECT_NO_THROW(prepare_dataset(options("out")));
  EXPECT_EQ(read_file(file), to_csv(own));
}

TEST_F(PrepareDataset, GoesOnAfterAnInterruption) {
  prepare_dataset(options("out"));
  const auto complete = test::dataset_files(folder_ / "out");
  const CsvTable table = read_csv(folder_ / "out" / "metadata.csv");
  // As if the program had died: one asset without its record, one with a damaged record, no tables yet.
  fs::remove(folder_ / "out" / "records" / (table.cell(0, "sha256") + ".json"));
  write_file_atomically(folder_ / "out" / "records" / (table.cell(1, "sha256") + ".json"), "{\"version\": 1");
  fs::remove(folder_ / "out" / "metadata.csv");
  EXPECT_EQ(prepare_dataset(options("out")).reused, 1u);
  EXPECT_EQ(test::dataset_files(folder_ / "out"), complete);
}

// Result of a merge when files went missing after they were recorded.
TEST_F(PrepareDataset, AMergeRefusesAnIncompleteAsset) {
  prepare_dataset(options("out"));
  const auto complete = test::dataset_files(folder_ / "out");
  EXPECT_NO_THROW(merge_dataset(folder_ / "out"));
  EXPECT_EQ(test::dataset_files(folder_ / "out"), complete);
  const CsvTable table = read_csv(folder_ / "out" / "metadata.csv");
  const AssetPlaces places{folder_ / "out", table.cell(0, "sha256")};
  write_file_atomically(places.skeleton_voxels(), "cut off");
  try {
    merge_dataset(folder_ / "out");
    FAIL() << "a file of another size";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("input/a.glb has files of voxels of another size"), std::string::npos)
        << error.what();
  }
  fs::remove(places.skeleton());
  EXPECT_THROW(merge_dataset(folder_ / "out"), Error);
  prepare_dataset(options("out"));
  EXPECT_EQ(test::dataset_files(folder_ / "out"), complete);
}

// Calls at the same time stand for processes; e2e.prepare_together has real ones, and kills them.
TEST_F(PrepareDataset, CallsAtTheSameTimeShareTheWork) {
  const PrepareSummary alone = prepare_dataset(options("alone"));
  std::vector<std::thread> threads;
  std::vector<PrepareSummary> summaries(3);
  std::mutex mutex;
  std::vector<std::string> problems;
  for (PrepareSummary& summary : summaries) {
    threads.emplace_back([&] {
      try {
        summary = prepare_dataset(options("together"));
      } catch (const std::exception& error) {
        const std::lock_guard<std::mutex> lock(mutex);
        problems.push_back(error.what());
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(problems, std::vector<std::string>());
  EXPECT_EQ(test::dataset_files(folder_ / "together"), test::dataset_files(folder_ / "alone"));
  for (const PrepareSummary& summary : summaries) {
    EXPECT_EQ(summary.real, alone.real);
    EXPECT_EQ(summary.train, alone.train);
    EXPECT_EQ(summary.rejected.size(), alone.rejected.size());
  }
}

TEST_F(PrepareDataset, OtherArgumentsMustWait) {
  const PrepareOptions ours = options("out");
  Manifest other;
  other.settings = {{"plan", "another one"}};
  const FileLock working = join_run(ours.out, other);
  EXPECT_THROW(prepare_dataset(ours), InputError);
}

TEST_F(PrepareDataset, FailsOnlyWhenNothingCouldBeUsed) {
  PrepareOptions broken = options("out");
  broken.sources = find_assets({input() / "z" / "truncated.glb"});
  EXPECT_THROW(prepare_dataset(broken), InputError);
  EXPECT_EQ(read_csv(folder_ / "out" / "rejected.csv").rows.size(), 1u);
  PrepareOptions too_many = options("out2");
  too_many.tables.split.test_count = 3;
  EXPECT_THROW(prepare_dataset(too_many), InputError);
  EXPECT_THROW(find_assets({folder_ / "absent"}), InputError);
  fs::create_directories(folder_ / "empty");
  EXPECT_THROW(find_assets({folder_ / "empty"}), InputError);
}

// Steps clear what they make anew: a dataset prepared onto itself would lose its sources.
TEST_F(PrepareDataset, RefusesSourcesInsideTheOutputFolder) {
  PrepareOptions inside = options("input");
  EXPECT_THROW(prepare_dataset(inside), InputError);
  inside.out = folder_.path();
  EXPECT_THROW(prepare_dataset(inside), InputError);
  EXPECT_TRUE(fs::exists(input() / "a.glb"));
  EXPECT_FALSE(fs::exists(input() / "records"));
  // A folder of the output that leads into the input.
  PrepareOptions linked = options("linked");
  fs::create_directories(folder_ / "linked");
  fs::create_directory_symlink(input(), folder_ / "linked/assets");
  EXPECT_THROW(prepare_dataset(linked), InputError);
  EXPECT_FALSE(fs::exists(folder_ / "linked/records"));
}

TEST_F(PrepareDataset, IdsFollowTheContentOfExternalBuffers) {
  const fs::path file = folder_ / "ext" / "a.gltf";
  write_file_atomically(file, "{\"buffers\": [{\"uri\": \"my%20data.bin\"}]}");
  write_file_atomically(folder_ / "ext" / "my data.bin", "one");
  const AssetSource source = find_assets({file})[0];
  const std::string first = asset_id(source);
  EXPECT_EQ(first.size(), 64u);
  write_file_atomically(folder_ / "ext" / "my data.bin", "two");
  EXPECT_NE(asset_id(source), first);
}

// The id of an asset is that of its shape and rig. Its pictures decide what is made of it all the same.
TEST_F(PrepareDataset, ChangedPicturesBesideAFileAreSeen) {
  Asset asset = small_asset(4, 1.5f);
  asset.mesh.uvs = {{0, 0}, {1, 0}, {0, 1}, {1, 1}};
  asset.mesh.face_materials.assign(asset.mesh.faces.size(), 0);
  asset.materials.push_back({});
  asset.materials[0].image = 0;
  const auto painted = [&](std::uint8_t red) {
    io::Image image(4, 4, 0xFF0000FFu);
    image.pixel(1, 1)[0] = red;
    return io::encode_png(image);
  };
  asset.images.push_back({"skin", "image/png", painted(10)});
  const fs::path file = folder_ / "painted/a.gltf", picture = folder_ / "painted/skin.png";
  io::write_gltf(file, asset);  // with the picture inside
  Json json = load_config(file);
  json["images"][0] = {{"uri", "skin.png"}};
  write_file_atomically(file, json.dump());
  const auto paint = [&](std::uint8_t red) {
    const std::vector<std::uint8_t> png = painted(red);
    write_file_atomically(picture, std::string(png.begin(), png.end()));
  };
  paint(10);
  PrepareOptions options;
  options.out = folder_ / "seen";
  options.sources = find_assets({folder_ / "painted"});
  options.tables.split.test_count = 0;
  const auto reused = [&] { return prepare_dataset(options).reused; };
  EXPECT_EQ(reused(), 0u);
  EXPECT_EQ(reused(), 1u);
  paint(200);
  EXPECT_EQ(reused(), 0u);
  EXPECT_EQ(reused(), 1u);
  fs::remove(picture);
  EXPECT_EQ(reused(), 0u) << "without its picture";
}

TEST(ShardDataset, KeepsUuidPathAndShardOfASampleAndHandsThemOn) {
  const test::TemporaryFolder folder;
  std::vector<test::RigFile> rigs(3);
  for (std::size_t i = 0; i < rigs.size(); ++i) {
    rigs[i].uuid = "u-" + std::to_string(i);
    rigs[i].joints[4] += 0.1 * static_cast<double>(i);
  }
  test::write_articulation_xl(folder / "in" / "sub" / "xl.npz", rigs);
  PrepareOptions options;
  options.out = folder / "out";
  options.sources = find_assets({folder / "in"});
  options.plan.variants = 1;
  options.tables.split.test_names = {"u-1", "sub/xl.npz#u-2"};
  EXPECT_EQ(prepare_dataset(options).test, 2u);
  options.sources = find_assets({folder / "out"});
  options.plan.variants = 0;
  options.out = folder / "again";
  options.tables.split.test_names = {"u-1"};
  EXPECT_EQ(prepare_dataset(options).test, 1u);
  for (const char* name : {"out", "again"}) {
    const CsvTable table = read_csv(folder / name / "metadata.csv");
    std::map<std::string, std::size_t> rows;
    for (std::size_t row = 0; row < table.rows.size(); ++row) {
      if (table.cell(row, "variant_of").empty()) rows[table.cell(row, "uuid")] = row;
    }
    ASSERT_EQ(rows.count("u-2"), 1u) << name;
    EXPECT_EQ(table.rows.size(), 6u) << "three samples, and the posed variant of each";
    EXPECT_EQ(table.cell(rows["u-2"], "source_path"), "sub/xl.npz") << name;
    EXPECT_EQ(table.cell(rows["u-2"], "local_path"), "sub/xl.npz#u-2") << name;
    EXPECT_EQ(table.flag(rows["u-2"], "is_test", false, ""), std::string(name) == "out");
    std::size_t poses_of_tests = 0;
    for (std::size_t row = 0; row < table.rows.size(); ++row) {
      const std::string& of = table.cell(row, "variant_of");
      if (of.empty()) continue;
      const bool is_test = table.flag(row, "is_test", false, "");
      EXPECT_EQ(is_test, of == table.cell(rows["u-1"], "sha256") ||
                             (std::string(name) == "out" && of == table.cell(rows["u-2"], "sha256")))
          << name;
      poses_of_tests += is_test ? 1 : 0;
    }
    EXPECT_EQ(poses_of_tests, std::string(name) == "out" ? 2u : 1u) << name;
  }
}

TEST(ProceduralDataset, TrainsOnAllUnlessTestCreaturesAreAskedFor) {
  const test::TemporaryFolder folder;
  PrepareOptions options;
  options.out = folder / "out";
  options.sources = procedural_sources(11, 3);
  options.plan.keep_assets = false;
  const PrepareSummary summary = prepare_dataset(options);
  EXPECT_EQ(summary.procedural, 3u);
  EXPECT_EQ(summary.test, 0u);
  EXPECT_FALSE(fs::exists(folder / "out" / "assets"));
  const CsvTable table = read_csv(folder / "out" / "metadata.csv");
  EXPECT_EQ(table.cell(2, "source"), "procedural:" + creatures::creature_family(11, 2));
  EXPECT_EQ(table.cell(2, "file_identifier"), "procedural/11/2");
  options.tables.split.procedural_test = 1;
  EXPECT_EQ(prepare_dataset(options).test, 1u);
}

TEST(ProceduralDataset, OfATestSeedIsForTestingAndOfAStreamNever) {
  const test::TemporaryFolder folder;
  PrepareOptions options;
  options.out = folder / "out";
  options.plan.steps = {"import"};
  options.sources = procedural_sources(creature_seeds::kFirstTest, 2);
  const PrepareSummary tests = prepare_dataset(options);
  EXPECT_EQ(tests.test, 2u - tests.bad_skeleton);
  EXPECT_EQ(tests.train, 0u);
  EXPECT_EQ(read_file(folder / "out" / "splits" / "train.txt"), "");
  options.out = folder / "stream";
  options.sources = stream_sources(0, 0, 2);
  const PrepareSummary streamed = prepare_dataset(options);
  EXPECT_EQ(streamed.train, 2u - streamed.bad_skeleton);
  options.tables.split.procedural_test = 1;
  EXPECT_THROW(prepare_dataset(options), InputError);
}

/// Names in the folder of a stream but for locks.
std::set<std::string> names_in(const fs::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.insert(entry.path().filename().string());
  names.erase(".locks");
  return names;
}

TEST(StreamDataset, ReplacesTheOldestShardWhenTrainingsHaveGoneOn) {
  const test::TemporaryFolder folder;
  const StreamFolder stream{folder / "stream"};
  StreamOptions options;
  options.shard.out = stream.root;
  options.shard.plan.steps = {"import"};
  options.creatures = 2;
  options.shards = 2;
  options.end = 2;
  EXPECT_EQ(stream_dataset(options), 2u);
  EXPECT_EQ(stream.read_index().shards, (std::vector<std::uint64_t>{0, 1}));
  EXPECT_EQ(stream.read_index().generation, 1u);
  const CsvTable table = read_csv(stream.shard(1) / "metadata.csv");
  EXPECT_EQ(table.cell(0, "file_identifier"), "procedural/1000000000000/2");

  // Half of a shard that a killed process left, and one it was removing.
  write_file_atomically(stream.making(2) / "voxels" / "half.tmp-1-1.ply", "");
  write_file_atomically(stream.retired(9) / "metadata.csv", "");
  options.end = 4;
  auto made = std::async(std::launch::async, [&] { return stream_dataset(options); });
  while (!fs::exists(stream.shard(2))) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_EQ(stream.read_index().generation, 1u) << "no training has the first generation yet";
  EXPECT_FALSE(fs::exists(stream.retired(9)));
  EXPECT_FALSE(fs::exists(stream.shard(2) / "voxels" / "half.tmp-1-1.ply"));
  stream.mark_used(1);
  while (stream.read_index().generation < 2) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_EQ(stream.read_index().shards, (std::vector<std::uint64_t>{2, 1}));
  while (!fs::exists(stream.shard(3))) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  EXPECT_TRUE(fs::exists(stream.shard(0))) << "a training without a checkpoint of generation 2 may come back to it";
  std::optional<FileLock> reader = FileLock::try_lock(stream.shard_lock(0), FileLock::Kind::kShared);
  stream.mark_used(2);
  EXPECT_EQ(made.get(), 4u);
  EXPECT_EQ(stream.read_index().shards, (std::vector<std::uint64_t>{2, 3}));
  EXPECT_TRUE(fs::exists(stream.shard(0))) << "somebody reads it";
  reader.reset();
  stream.mark_used(3);
  EXPECT_EQ(stream_dataset(options), 4u) << "nothing is left to do but to clear away";
  EXPECT_EQ(names_in(stream.root), (std::set<std::string>{"stream.json", "used.json", "shard-000002", "shard-000003"}));

  options.creatures = 3;
  EXPECT_THROW(stream_dataset(options), InputError) << "other options";
  options.shard.out = folder.path();
  EXPECT_THROW(stream_dataset(options), InputError) << "a folder of something else";
}

TEST(StreamDataset, ShowsAShardOnlyWhenItsCommandsHaveSucceeded) {
  const test::TemporaryFolder folder;
  const StreamFolder stream{folder / "stream"};
  StreamOptions options;
  options.shard.out = stream.root;
  options.shard.plan.steps = {"import"};
  options.creatures = options.shards = 1;
  options.end = 1;
  options.commands = {{"/bin/false"}};
  EXPECT_THROW(stream_dataset(options), Error);
  EXPECT_EQ(stream.read_index().generation, 0u);
  EXPECT_FALSE(fs::exists(stream.shard(0)));
  options.commands = {{"/bin/rmdir", "--ignore-fail-on-non-empty"}};
  EXPECT_EQ(stream_dataset(options), 1u);
  EXPECT_TRUE(fs::exists(stream.shard(0)));
}

TEST(RealAssets, CorruptWeightsAreFlaggedNotRejected) {
  const fs::path crab = test::assets_dir() / "rigged" / "arthropod" / "q_crab_nan.glb";
  if (!fs::exists(crab)) {
    GTEST_SKIP() << crab << " is missing";
  }
  const test::TemporaryFolder folder;
  PrepareOptions options;
  options.out = folder / "out";
  options.sources = find_assets({crab});
  EXPECT_TRUE(prepare_dataset(options).rejected.empty());
  const CsvTable table = read_csv(folder / "out" / "metadata.csv");
  EXPECT_NE(table.cell(0, "repairs").find("nan_weights"), std::string::npos);
}

}  // namespace
}  // namespace anigen::prepare
