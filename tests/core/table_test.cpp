#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/core/table.h"

namespace anigen {

namespace {

TEST(Csv, QuotesOnlyWhatNeedsIt) {
  EXPECT_EQ(csv_field("plain text"), "plain text");
  EXPECT_EQ(csv_field("a,b"), "\"a,b\"");
  EXPECT_EQ(csv_field("say \"hi\""), "\"say \"\"hi\"\"\"");
  EXPECT_EQ(csv_field("two\nlines"), "\"two\nlines\"");
  EXPECT_EQ(csv_field(" blank"), "\" blank\"");
  EXPECT_EQ(csv_field(""), "");
}

TEST(Csv, ReadsBackWhatItWrites) {
  CsvTable table;
  table.columns = {"id", "path, with comma", "note"};
  table.rows = {{"1", "a\"b", "x\r\ny"}, {"", "", ""}, {"3", "ünïcode", ","}};
  const CsvTable again = parse_csv(to_csv(table), "memory");
  EXPECT_EQ(again.columns, table.columns);
  EXPECT_EQ(again.rows, table.rows);
}

TEST(Csv, AcceptsCrLfByteOrderMarkAndAMissingLastLineBreak) {
  const CsvTable table = parse_csv("\xEF\xBB\xBFsha256,is_test\r\nabc,True\r\n\r\ndef,False", "memory");
  ASSERT_EQ(table.rows.size(), 2u);
  EXPECT_EQ(table.cell(1, "sha256"), "def");
  EXPECT_TRUE(table.flag(0, "is_test", false, "memory"));
  EXPECT_FALSE(table.flag(1, "is_test", true, "memory"));
  EXPECT_TRUE(table.flag(1, "absent", true, "memory"));
}

TEST(Csv, NamesTheLineOfWhatIsWrong) {
  const auto place = [](const char* text) -> std::string {
    try {
      parse_csv(text, "memory");
    } catch (const InputError& error) {
      return error.place();
    }
    return "accepted";
  };
  EXPECT_EQ(place(""), "line 1");
  EXPECT_EQ(place("a,b\n1,2\n3\n"), "line 3");
  EXPECT_EQ(place("a,b\n\"x\ny\",2\n3,\"open\n"), "line 4");
  EXPECT_EQ(place("a,a\n"), "line 1");
  EXPECT_EQ(place("a,b\n\"x\"y,2\n"), "line 2");
  const CsvTable table = parse_csv("flag\nmaybe\n", "memory");
  EXPECT_THROW(table.flag(0, "flag", false, "memory"), InputError);
}

}  // namespace

namespace {

const Table kTable{{"method", "a_b ↓"}, {{"first", "**0.1 ± 0.2**"}, {"", "_0.3_"}, {"50 % & more", "–"}}};

TEST(Fixed, ZeroHasNoSign) {
  EXPECT_EQ(fixed(-1e-17), "0.0000");
  EXPECT_EQ(fixed(-0.0, 2), "0.00");
  EXPECT_EQ(fixed(-0.12346), "-0.1235");
}

TEST(Significant, WritesUpToSoManyDigits) {
  EXPECT_EQ(significant(0.123456, 3), "0.123");
  EXPECT_EQ(significant(1234.0, 6), "1234");
  EXPECT_EQ(significant(1.5, 3), "1.5");
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

}  // namespace

}  // namespace anigen
