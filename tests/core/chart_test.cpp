#include "anigen/core/chart.h"

#include <gtest/gtest.h>

#include <cmath>

namespace anigen {
namespace {

TEST(LineChart, DrawsOnlyWhatIsACurve) {
  EXPECT_EQ(line_chart("t", {}), "");
  EXPECT_EQ(line_chart("t", {{1, 1}, {2, std::nan("")}}), "");
  const std::string svg = line_chart("eval.l1 <x>", {{0, 1}, {10, 0.5}});
  EXPECT_NE(svg.find("<polyline"), std::string::npos);
  EXPECT_NE(svg.find("&lt;x&gt;"), std::string::npos);
}

TEST(LineChart, SeveralCurvesHaveALegendAndShortOnesAreLeftOut) {
  const std::string svg =
      curves_chart("Loss", {{"one", {{0, 3}, {1, 2}}}, {"two", {{0, 1}, {2, 4}}}, {"dot", {{0, 1}}}});
  EXPECT_NE(svg.find("one, last 2"), std::string::npos);
  EXPECT_NE(svg.find("two, last 4"), std::string::npos);
  EXPECT_EQ(svg.find("dot"), std::string::npos);
  EXPECT_EQ(curves_chart("Loss", {{"dot", {{0, 1}}}}), "");
  const std::string single = line_chart("Loss", {{0, 3}, {1, 2}});
  EXPECT_NE(single.find("Loss, last 2"), std::string::npos);
}

}  // namespace
}  // namespace anigen
