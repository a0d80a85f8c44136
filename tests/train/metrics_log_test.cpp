#include "anigen/train/metrics_log.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "tests/support/paths.h"

namespace anigen::train {
namespace {

TEST(MetricsLog, NewQuantitiesBecomeColumns) {
  const test::TemporaryFolder folder;
  MetricsLog log(folder / "metrics.csv", 0);
  log.append(10, {{"loss", 0.5}});
  log.append(20, {{"eval.l1", 0.25}});
  log.append(30, {{"loss", std::nan("")}, {"eval.l1", 1e-7}});
  EXPECT_EQ(read_file(folder / "metrics.csv"), "step,loss,eval.l1\n10,0.5,\n20,,0.25\n30,nan,1e-07\n");
}

TEST(MetricsLog, ResumingDropsLaterRowsAndATornLine) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "metrics.csv") << "step,loss\n10,3\n20,2\n30,1\n40,0";
  MetricsLog log(folder / "metrics.csv", 20);
  log.append(30, {{"loss", 7}});
  EXPECT_EQ(read_file(folder / "metrics.csv"), "step,loss\n10,3\n20,2\n30,7.0\n");
}

TEST(MetricsLog, AnotherFileIsRefused) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "metrics.csv") << "sha256,x\na,1\n";
  EXPECT_THROW(MetricsLog(folder / "metrics.csv", 0), InputError);
}

TEST(RunningMeans, StepsThatAreNotFiniteDoNotCount) {
  RunningMeans means;
  for (const double value : {1.0, std::nan(""), 3.0}) means.add("a", value);
  means.add("b", std::nan(""));
  EXPECT_EQ(means.means()[0].second, 2.0);
  EXPECT_TRUE(std::isnan(means.means()[1].second));
}

}  // namespace
}  // namespace anigen::train
