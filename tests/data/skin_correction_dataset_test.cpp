#include "anigen/data/skin_correction_dataset.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "tests/data/limb_dataset.h"
#include "tests/support/paths.h"

namespace anigen::data {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kVertices = 16, kCandidates = 6;

class SkinCorrectionData : public ::testing::Test {
 protected:
  SkinCorrectionData() { test::write_limb_dataset(data(), 6); }

  fs::path data() const { return folder_ / "data"; }
  Datasets made(Json args = Json::object(), std::uint64_t seed = 1) const {
    if (!args.contains("data_dir")) args["data_dir"] = data().string();
    args["geovoxel_resolution"] = 32;
    args["candidates"] = kCandidates;
    args["vertices"] = kVertices;
    if (!args.contains("cached_vertices")) args["cached_vertices"] = 50;
    const Json dataset = {{"name", "AniGenSkinCorrections"}, {"args", args}};
    return make_datasets(ConfigReader(dataset, "config.json", "/dataset"), seed);
  }
  static std::unique_ptr<SkinCorrectionBatch> batch(const Datasets& data, const std::vector<Draw>& draws) {
    std::unique_ptr<Batch> loaded = data.train->load(draws);
    return std::unique_ptr<SkinCorrectionBatch>(dynamic_cast<SkinCorrectionBatch*>(loaded.release()));
  }
  static const SkinCorrectionDataset& typed(const std::shared_ptr<const BatchSource>& source) {
    return dynamic_cast<const SkinCorrectionDataset&>(*source);
  }
  static std::set<std::string> ids(const std::shared_ptr<const BatchSource>& source) {
    std::set<std::string> found;
    for (std::size_t i = 0; i < typed(source).assets(); ++i) found.insert(typed(source).asset(i).id);
    return found;
  }
  fs::path cached(const std::string& id) const { return data() / "skin_features" / (id + ".npz"); }
  void expect_refused(const Json& args, const std::string& words) const {
    try {
      made(args);
      ADD_FAILURE() << "accepted; expected: " << words;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
    }
  }

  test::TemporaryFolder folder_;
};

TEST_F(SkinCorrectionData, BatchesHoldVerticesWithTheirTrueWeights) {
  const auto found = batch(made(), {{0, 0}, {1, 1}});
  const std::int64_t rows = 2 * kVertices;
  EXPECT_EQ(found->pairs.sizes(), (std::vector<std::int64_t>{rows, kCandidates, rigging::kSkinPairFeatures}));
  EXPECT_EQ(found->assets.sizes(), (std::vector<std::int64_t>{rows, rigging::kSkinAssetFeatures}));
  EXPECT_TRUE(found->pairs.isfinite().all().item<bool>());
  EXPECT_LT((found->truth.sum(1) + found->missed - 1.0).abs().max().item<float>(), 1e-5F);
  EXPECT_EQ(found->missed.max().item<float>(), 0.0F) << "fewer joints than candidates";
  EXPECT_EQ((found->truth * found->present.logical_not()).max().item<float>(), 0.0F);
  EXPECT_EQ(found->present.sum(1).min().item<std::int64_t>(), 3);
  ASSERT_EQ(found->ids.size(), 2U);
}

TEST_F(SkinCorrectionData, SamplesDependOnSeedAndPositionAlone) {
  const Datasets data = made();
  const auto together = batch(data, {{0, 3}, {1, 4}}), alone = batch(data, {{1, 4}});
  EXPECT_TRUE(torch::equal(together->pairs.narrow(0, kVertices, kVertices), alone->pairs));
  EXPECT_FALSE(torch::equal(batch(data, {{1, 5}})->pairs, alone->pairs));
  EXPECT_FALSE(torch::equal(batch(made(Json::object(), 2), {{1, 4}})->pairs, alone->pairs));
  EXPECT_TRUE(torch::equal(batch(made(), {{1, 4}})->pairs, alone->pairs)) << "from files";
}

TEST_F(SkinCorrectionData, ClassicalWeightsAreSometimesUnseenInTrainingAlone) {
  Json args = {{"drop_classical", 1.0}, {"eval_split", "splits/test.txt"}};
  const Datasets data = made(args);
  for (std::uint64_t position = 0; position < 8; ++position) {
    const torch::Tensor pairs = batch(data, {{0, position}})->pairs;
    const bool heat = (pairs.select(2, rigging::kHeatLog) > -9.0).any().item<bool>();
    const bool geodesic = (pairs.select(2, rigging::kGeodesicLog) > -9.0).any().item<bool>();
    EXPECT_NE(heat, geodesic) << position;
  }
  const torch::Tensor held_out = typed(data.eval).all_of(0)->pairs;
  EXPECT_TRUE((held_out.select(2, rigging::kHeatLog) > -9.0).any().item<bool>());
  EXPECT_TRUE((held_out.select(2, rigging::kGeodesicLog) > -9.0).any().item<bool>());
  EXPECT_EQ(held_out.size(0), 50) << "all kept vertices";
}

TEST_F(SkinCorrectionData, FeaturesAreComputedOnceAndAgainWhenSomethingChanges) {
  made();
  ASSERT_TRUE(fs::exists(cached("limb0")));
  const auto written = [&](const char* id) { return fs::last_write_time(cached(id)); };
  const auto first = written("limb0"), other = written("limb1");
  made();
  EXPECT_EQ(written("limb0"), first);
  write_file_atomically(cached("limb0"), "damaged");
  made();
  EXPECT_NE(read_file(cached("limb0")), "damaged");
  EXPECT_EQ(written("limb1"), other);
  test::write_limb(data() / "skeleton/limb1/skeleton_voxelized.npz", 5, 0.08);
  made();
  EXPECT_NE(written("limb1"), other) << "another rig";
  // Two rigs in files of one size.
  const fs::path changed = data() / "skeleton/limb3/skeleton_voxelized.npz";
  std::map<std::uintmax_t, double> radius_of_size;
  double first_radius = 0.0, second_radius = 0.0;
  for (int i = 1; first_radius == 0.0; ++i) {
    ASSERT_LT(i, 1000);
    second_radius = 0.08 + 1e-4 * i;
    test::write_limb(changed, test::limb_joints(3), second_radius);
    const auto [known, is_new] = radius_of_size.emplace(fs::file_size(changed), second_radius);
    if (!is_new) first_radius = known->second;
  }
  test::write_limb(changed, test::limb_joints(3), first_radius);
  made();
  const auto unchanged = written("limb3");
  test::write_limb(changed, test::limb_joints(3), second_radius);
  made();
  EXPECT_NE(written("limb3"), unchanged) << "a rig of the old one's size";
  const auto before = written("limb2");
  made({{"cached_vertices", 20}});
  EXPECT_NE(written("limb2"), before) << "another option";
}

TEST_F(SkinCorrectionData, FeaturesCanLieElsewhere) {
  made({{"cache", (folder_ / "elsewhere").string()}});
  EXPECT_TRUE(fs::exists(folder_ / "elsewhere/limb0.npz"));
  EXPECT_FALSE(fs::exists(data() / "skin_features"));
}

TEST_F(SkinCorrectionData, RealRigsHaveTheirShareOfTheSamples) {
  for (const double share : {0.25, 0.5, 0.8}) {
    const Datasets data = made({{"real_share", share}});
    std::map<bool, double> visits;
    for (std::size_t item = 0; item < data.train->size(); ++item) {
      const std::string id = data.train->load({{item, 0}})->ids.front();
      visits[(id.back() - '0') % 2 == 0] += 1.0;
    }
    EXPECT_NEAR(visits[true] / (visits[true] + visits[false]), share, 0.05) << share;
  }
}

TEST_F(SkinCorrectionData, EverySkeletonCanComeEquallyOften) {
  test::write_limb_dataset(data(), 10);  // two rigs to train on share a tree, two others have one each
  const Datasets data = made({{"real_share", 0.5}, {"even_skeletons", true}, {"split", "splits/train.txt"}});
  std::map<std::string, double> visits;
  for (std::size_t item = 0; item < data.train->size(); ++item)
    visits[data.train->load({{item, 0}})->ids.front()] += 1.0;
  EXPECT_EQ(visits["limb0"], visits["limb6"]);
  EXPECT_EQ(visits["limb0"] + visits["limb6"], visits["limb2"]);
  EXPECT_EQ(visits["limb2"], visits["limb4"]);
}

TEST_F(SkinCorrectionData, NoRigOfACommonSkeletonIsLeftOut) {
  constexpr int kRigs = 70;
  std::ofstream csv(data() / "metadata.csv");
  csv << "sha256,file_identifier,source,is_bad_skin,is_bad_skeleton\nlimb1,procedural/5/"
         "1,procedural:limb,False,False\n";
  for (int i = 0; i < kRigs; ++i) {
    const std::string id = "arm" + std::to_string(i);
    csv << id << ",limbs/" << id << ".glb,real,False,False\n";
    fs::create_directories(data() / "skeleton" / id);
    test::write_limb(data() / "skeleton" / id / "skeleton_voxelized.npz", 3, 0.05);
  }
  csv.close();
  const Datasets found = made({{"real_share", 0.5}, {"even_skeletons", true}, {"cached_vertices", 10}});
  std::set<std::string> visited;
  for (std::size_t item = 0; item < found.train->size(); ++item)
    visited.insert(found.train->load({{item, 0}})->ids.front());
  EXPECT_EQ(visited.size(), static_cast<std::size_t>(kRigs) + 1);
}

TEST_F(SkinCorrectionData, EveryRealRigIsHeldOutInOneFoldWithAllOfItsTree) {
  // Three real rigs of three trees; a fourth one shares a tree.
  test::write_limb_dataset(data(), 8);
  std::multiset<std::string> held_out;
  constexpr int kFolds = 2;
  for (int fold = 0; fold < kFolds; ++fold) {
    try {
      const Datasets found =
          made({{"fold", std::to_string(fold) + "/" + std::to_string(kFolds)}, {"split", "splits/train.txt"}});
      const std::set<std::string> trained = ids(found.train), kept = ids(found.eval);
      for (const std::string& id : kept) {
        EXPECT_EQ(trained.count(id), 0U) << id;
        EXPECT_EQ((id.back() - '0') % 2, 0) << id << " is a creature";
        held_out.insert(id);
      }
      EXPECT_EQ(trained.count("limb7"), 0U) << "of the split for tests";
      EXPECT_EQ(trained.count("limb1"), 1U);
      EXPECT_EQ(kept.count("limb0"), kept.count("limb6")) << "one tree";
    } catch (const InputError& error) {
      // By its hash every tree may be of the other fold.
      EXPECT_NE(std::string(error.what()).find("holds no skeleton out"), std::string::npos) << error.what();
    }
  }
  EXPECT_EQ(held_out, (std::multiset<std::string>{"limb0", "limb2", "limb4", "limb6"}));
}

TEST_F(SkinCorrectionData, RigsWithABadSkeletonTakePartWhereWanted) {
  std::string csv = read_file(data() / "metadata.csv");
  csv.replace(csv.find("real,False,False") + 11, 5, "True");
  write_file_atomically(data() / "metadata.csv", csv);
  EXPECT_EQ(ids(made().train).count("limb0"), 0U);
  EXPECT_EQ(ids(made({{"bad_skeletons", true}}).train).count("limb0"), 1U);
}

TEST_F(SkinCorrectionData, BadInputIsNamed) {
  for (const char* fold : {"5/5", "1/1", "1", "a/b", "-1/3", "1/2/3"})
    expect_refused({{"fold", fold}}, "/dataset/args/fold");
  expect_refused({{"fold", "0/2"}, {"eval_fraction", 0.5}}, "eval_fraction");
  expect_refused({{"real_share", 2.0}}, "real_share");
  expect_refused({{"drop_classical", -1}}, "drop_classical");
  expect_refused({{"cache", ""}}, "cache");
  write_file_atomically(data() / "skeleton/limb3/skeleton_voxelized.npz", "no rig");
  expect_refused(Json::object(), "limb3");
  const Datasets without = made({{"skip_broken", true}});
  EXPECT_EQ(ids(without.train).count("limb3"), 0U);
}

TEST_F(SkinCorrectionData, CreaturesThatAreKeptForTestingAreNotTrainedOn) {
  std::string csv = read_file(data() / "metadata.csv");
  csv.replace(csv.find("procedural/5/1"), 14, "procedural/900000001/1");
  write_file_atomically(data() / "metadata.csv", csv);
  expect_refused(Json::object(), "900000001");
}

}  // namespace
}  // namespace anigen::data
