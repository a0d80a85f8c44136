#include "anigen/core/version.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <regex>

#include "anigen/core/files.h"
#include "tests/support/paths.h"

namespace anigen {
namespace {

namespace fs = std::filesystem;

TEST(Version, IsThatOfTheProjectAndNamesACommit) {
  const std::string lists = read_file(test::source_dir() / "CMakeLists.txt");
  EXPECT_NE(lists.find("project(anigen VERSION " + std::string(kVersion) + " "), std::string::npos) << kVersion;
  EXPECT_TRUE(std::regex_match(commit(), std::regex("[0-9a-f]{10}(\\+changes)?|unknown"))) << commit();
  EXPECT_NE(named_version().find(commit()), std::string::npos);
  EXPECT_NE(named_commit("").find("no commit"), std::string::npos);
}

TEST(Version, RecordNamesWhatMadeAResult) {
  const Json record = made_by();
  EXPECT_EQ(record["version"], kVersion);
  EXPECT_EQ(record["commit"], commit());
  EXPECT_TRUE(std::regex_match(record["compiler"].get<std::string>(), std::regex("[A-Za-z]+ [0-9.]+"))) << record;
  EXPECT_EQ(record.value("libtorch", ""), kTorchVersion);
  EXPECT_EQ(commit_of({{"made_by", record}}), commit());
  for (const Json& other :
       {Json::object(), Json({{"made_by", 3}}), Json({{"made_by", {{"commit", nullptr}}}}), Json(1)})
    EXPECT_EQ(commit_of(other), "") << other;
}

/// The script that writes the commit into a source, on a small checkout of its own.
class CommitOfABuild : public ::testing::Test {
 protected:
  void SetUp() override {
    if (run("git --version") != 0 || run("cmake --version") != 0) {
      GTEST_SKIP() << "needs git and cmake";
    }
    fs::create_directories(folder_ / "checkout" / "anigen");
    fs::create_directories(folder_ / "checkout" / "docs");
    write("anigen/a.cpp", "one");
    write("docs/a.md", "one");
  }

  static int run(const std::string& line) { return std::system((line + " >/dev/null 2>&1").c_str()); }
  void git(const std::string& words) {
    ASSERT_EQ(run("git -C '" + (folder_ / "checkout").string() +
                  "' -c user.name=x -c user.email=x@example.org -c commit.gpgsign=false " + words),
              0)
        << words;
  }
  void write(const std::string& name, const std::string& text) {
    std::ofstream(folder_ / ("checkout/" + name)) << text;
  }
  void commit_all(const std::string& message) {
    git("add -A");
    git("commit -m " + message);
  }
  std::string head() {
    const fs::path file = folder_ / "head";
    EXPECT_EQ(
        std::system(
            ("git -C '" + (folder_ / "checkout").string() + "' rev-parse HEAD > '" + file.string() + "'").c_str()),
        0);
    return read_file(file).substr(0, 10);
  }
  /// Writes the source as a build does. @return the commit in it
  std::string stamped(const std::string& below = "checkout") {
    EXPECT_EQ(run("cmake -D ROOT='" + (folder_ / below).string() + "' -D OUTPUT='" + source_.string() +
                  "' -D VERSION=9.8.7 -P '" + (test::source_dir() / "cmake/AnigenVersion.cmake").string() + "'"),
              0);
    const std::string text = read_file(source_), mark = "anigen commit: ";
    EXPECT_NE(text.find("kVersion = \"9.8.7\""), std::string::npos) << text;
    const std::size_t begin = text.find(mark) + mark.size();
    return text.substr(begin, text.find('"', begin) - begin);
  }

  test::TemporaryFolder folder_;
  fs::path source_ = folder_ / "version.cpp";
};

TEST_F(CommitOfABuild, IsUnknownOutsideGitAndInAnArchiveInsideAnotherCheckout) {
  EXPECT_EQ(stamped(), "unknown");
  git("init -q");
  EXPECT_EQ(stamped(), "unknown") << "no commit yet";
  fs::create_directories(folder_ / "checkout" / "vendored" / "anigen");
  write("vendored/anigen/a.cpp", "one");
  commit_all("first");
  EXPECT_EQ(stamped("checkout/vendored"), "unknown");
  EXPECT_EQ(stamped(), head());
}

TEST_F(CommitOfABuild, IsTheNewestOneThatChangedTheProgramsAndSaysWhatWasChangedSince) {
  git("init -q");
  commit_all("first");
  const std::string first = head();
  EXPECT_EQ(stamped(), first);
  // Neither a commit of documents nor a change of them makes another program.
  write("docs/a.md", "two");
  EXPECT_EQ(stamped(), first);
  commit_all("second");
  EXPECT_NE(head(), first);
  EXPECT_EQ(stamped(), first);

  write("anigen/a.cpp", "two");
  EXPECT_EQ(stamped(), first + "+changes");
  write("anigen/a.cpp", "one");
  EXPECT_EQ(stamped(), first);
  write("anigen/b.cpp", "new");
  EXPECT_EQ(stamped(), first + "+changes") << "a new source is compiled as well";
  commit_all("third");
  EXPECT_EQ(stamped(), head());
}

// A build compiles the source again when its time changes.
TEST_F(CommitOfABuild, IsWrittenOnlyWhenItChanges) {
  git("init -q");
  commit_all("first");
  stamped();
  const auto long_ago = fs::file_time_type::clock::now() - std::chrono::hours(24);
  fs::last_write_time(source_, long_ago);
  const auto written = fs::last_write_time(source_);
  stamped();
  EXPECT_EQ(fs::last_write_time(source_), written);
  write("anigen/a.cpp", "two");
  stamped();
  EXPECT_NE(fs::last_write_time(source_), written);
}

}  // namespace
}  // namespace anigen
