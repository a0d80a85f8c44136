#include "anigen/eval/tables.h"

#include <gtest/gtest.h>

#include "anigen/eval/line_chart.h"

namespace anigen::eval {
namespace {

const Table kTable{{"method", "a_b ↓"}, {{"first", "**0.1 ± 0.2**"}, {"", "_0.3_"}, {"50 % & more", "–"}}};

TEST(Fixed, ZeroHasNoSign) {
  EXPECT_EQ(fixed(-1e-17), "0.0000");
  EXPECT_EQ(fixed(-0.0, 2), "0.00");
  EXPECT_EQ(fixed(-0.12346), "-0.1235");
}

TEST(Tables, MarksBecomeEmphasis) {
  const std::string html = to_html(kTable);
  EXPECT_NE(html.find("<td><b>0.1 ± 0.2</b></td>"), std::string::npos);
  EXPECT_NE(html.find("<td><i>0.3</i></td>"), std::string::npos);
  EXPECT_NE(html.find("50 % &amp; more"), std::string::npos);
  EXPECT_EQ(without_marks("**").place, 0);
  EXPECT_EQ(without_marks("_x").text, "_x");
}

TEST(Tables, LatexEscapesSignsAndKeepsEmptyCells) {
  const std::string latex = to_latex(kTable);
  EXPECT_NE(latex.find("\\begin{tabular}{lr}"), std::string::npos);
  EXPECT_NE(latex.find("method & a\\_b $\\downarrow$ \\\\"), std::string::npos);
  EXPECT_NE(latex.find("first & \\textbf{0.1 $\\pm$ 0.2}"), std::string::npos);
  EXPECT_NE(latex.find("\n & \\underline{0.3}"), std::string::npos);
  EXPECT_NE(latex.find("50 \\% \\& more & --"), std::string::npos);
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
}  // namespace anigen::eval
