#include "anigen/loaders/source_options.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "tests/support/paths.h"

namespace anigen::loaders {
namespace {

TEST(SourceOptions, SmallerTrainingSharesArePartOfLargerOnesAndLeaveHeldOutAssetsAlone) {
  const test::TemporaryFolder folder;
  std::string table = "sha256\n", held_out;
  for (int i = 0; i < 300; ++i) {
    table += "asset" + std::to_string(i) + "\n";
    if (i % 10 == 0) held_out += "asset" + std::to_string(i) + "\n";
  }
  write_file_atomically(folder / "metadata.csv", table);
  write_file_atomically(folder / "test.txt", held_out);
  SourceOptions options;
  options.data_dir = folder.path().string();
  options.eval_split = "test.txt";
  std::set<std::string> larger;
  for (const double share : {1.0, 0.5, 0.25, 0.125}) {
    options.train_share = share;
    const TrainAndEval chosen = select(options);
    EXPECT_EQ(chosen.eval.size(), 30u);
    // Four standard deviations of a binomial choice.
    EXPECT_NEAR(static_cast<double>(chosen.train.size()), 270 * share, 4 * std::sqrt(270 * share * (1 - share)));
    std::set<std::string> ids;
    for (const AssetId& asset : chosen.train) ids.insert(asset.id);
    for (const std::string& id : ids) EXPECT_TRUE(larger.empty() || larger.count(id) > 0) << id;
    larger = ids;
  }
  options.train_share = 0;
  EXPECT_THROW(select(options), InputError);
  options.train_share = 0.5;
  options.eval_split.clear();
  options.eval_fraction = 0.2;
  const std::size_t held = select(options).eval.size();
  options.train_share = 1;
  EXPECT_EQ(select(options).eval.size(), held);
}

}  // namespace
}  // namespace anigen::loaders
