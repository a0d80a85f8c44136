#include <gtest/gtest.h>

#include "anigen/io/rigs/shape_source.h"
#include "anigen/io/rigs/split.h"
#include "tests/io/array_file_bytes.h"
#include "tests/support/rig_files.h"

namespace anigen::io {
namespace {

using Ids = std::vector<std::string>;

/// A source of names only.
class Names : public ShapeSource {
 public:
  explicit Names(Ids ids, std::map<std::string, Ids> others = {}) : ids_(std::move(ids)), others_(std::move(others)) {}
  Ids ids() const override { return ids_; }
  RiggedShape read(const std::string&) const override { return {}; }
  std::string describe() const override { return "names"; }
  Ids other_names(const std::string& id) const override {
    const auto found = others_.find(id);
    return found == others_.end() ? Ids{} : found->second;
  }

 private:
  Ids ids_;
  std::map<std::string, Ids> others_;
};

TEST(Split, SelectsInTheSourcesOrderAndNamesTheLineOfAnUnknownId) {
  const test::TemporaryFolder folder;
  const Names source({"a", "b", "c"}, {{"c", {"cat", "same"}}, {"b", {"same"}}});
  test::write_quickly(folder / "test.txt", "# the test split\r\n\r\n  cat \r\na\r\n");
  test::write_quickly(folder / "more.txt", "a\nb");
  EXPECT_EQ(select_ids(source, {}), (Ids{"a", "b", "c"}));
  EXPECT_EQ(select_ids(source, {folder / "test.txt"}), (Ids{"a", "c"}));
  EXPECT_EQ(select_ids(source, {folder / "test.txt", folder / "more.txt"}), (Ids{"a", "b", "c"}));
  EXPECT_EQ(select_ids(source, {}, 2), (Ids{"a", "b"}));
  EXPECT_EQ(select_ids(source, {folder / "test.txt"}, 1), Ids{"c"}) << "the split's first, not the source's";
  EXPECT_EQ(read_split(folder / "test.txt")[0].line, 3u);
  test::write_quickly(folder / "short.txt", "d\n");
  EXPECT_EQ(select_ids(Names({"c/e", "x/d"}), {folder / "short.txt"}), Ids{"x/d"});
  const auto problem = [&](const std::string& text) {
    test::write_quickly(folder / "bad.txt", text);
    return test::refusal([&] { select_ids(source, {folder / "bad.txt"}); });
  };
  EXPECT_EQ(problem("a\n\nz\n"), "line 3: there is no \"z\" in names");
  EXPECT_EQ(problem("same\n"), "line 1: several shapes are called \"same\" in names");
  EXPECT_EQ(problem("# nothing\n"), "the split names no id");
  EXPECT_NE(test::refusal([&] { read_split(folder / "missing.txt"); }), "");
}

}  // namespace
}  // namespace anigen::io
