#include "anigen/eval/skin_evaluation.h"

#include <gtest/gtest.h>

#include "anigen/core/files.h"
#include "anigen/io/arrays/npz.h"
#include "tests/support/paths.h"

namespace anigen::eval {
namespace {

std::size_t occurrences(const std::string& text, const std::string& word) {
  std::size_t count = 0;
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) ++count;
  return count;
}

TEST(SkinReport, IsOneFileWithTablesPicturesAndCurves) {
  const test::TemporaryFolder folder;
  write_file_atomically(folder / "data" / "metadata.csv",
                        "sha256,local_path\na,<first>.glb\nb,second.glb\nc,third.glb\n");
  write_file_atomically(folder / "metrics.csv", "step,loss,eval.skin_l1\n10,1,0.5\n20,0.5,\n30,0.2,0.25\n");
  for (const char* id : {"a", "b"}) {  // "c" has no arrays
    io::write_npz(
        folder / "data" / "skeleton" / id / "skeleton_voxelized.npz",
        {{"joints", io::NdArray::from(std::vector<float>{0, 0, -0.5f, 0, 0, 0.2f}, {2, 3})},
         {"parents", io::NdArray::from(std::vector<std::int32_t>{-1, 0}, {2})},
         {"skin", io::NdArray::from(std::vector<float>{1, 0, 0.5f, 0.5f, 0, 1}, {3, 2})},
         {"vertices", io::NdArray::from(std::vector<float>{-0.5f, 0, -0.5f, 0.5f, 0, -0.5f, 0, 0, 0.5f}, {3, 3})},
         {"faces", io::NdArray::from(std::vector<std::int32_t>{0, 1, 2}, {1, 3})}});
  }
  const SkinEvaluation evaluation = evaluate_skin(folder / "data", io::list_dataset(folder / "data"), skin_baselines());
  ReportOptions options;
  options.title = "A <report>";
  options.dataset = folder / "data";
  options.training_metrics = folder / "metrics.csv";
  options.pictured = 1;
  options.picture_size = 48;
  const std::string html = skin_report(evaluation, options);

  EXPECT_EQ(occurrences(html, "data:image/png;base64,iVBOR"), 2u) << "the worst and the best asset";
  EXPECT_EQ(occurrences(html, "<polyline"), 1u) << "only columns named eval are curves";
  EXPECT_EQ(occurrences(html, "http"), 0u) << "nothing is loaded from elsewhere";
  EXPECT_NE(html.find("A &lt;report&gt;"), std::string::npos);
  EXPECT_NE(html.find("&lt;first&gt;.glb"), std::string::npos);
  EXPECT_NE(html.find("third.glb"), std::string::npos);
  EXPECT_EQ(occurrences(html, "<table>"), occurrences(html, "</table>"));
}

}  // namespace
}  // namespace anigen::eval
