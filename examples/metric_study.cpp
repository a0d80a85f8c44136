// Behaviour of the metrics on real rigs where the answer is known, as Markdown: the tables of docs/results.md.
//   example_metric_study FOLDER_OF_RIGS OUT.md
#include <cstdio>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/eval/study.h"
#include "anigen/io/rigs/rigged_shape.h"

int main(int argc, char** argv) {
  using namespace anigen;
  if (argc != 3) {
    std::fputs("usage: example_metric_study FOLDER_OF_RIGS OUT.md\n", stderr);
    return 2;
  }
  try {
    const auto source = io::open_source(argv[1]);
    std::vector<io::RiggedShape> shapes;
    for (const std::string& id : source->ids()) {
      try {
        shapes.push_back(source->read(id));
      } catch (const InputError& error) {
        std::fprintf(stderr, "left out: %s\n", error.what());
      }
    }
    if (shapes.empty()) throw InputError(argv[1], "", "no shape could be read");
    std::string text = "# What the metrics do where the answer is known\n\nMade by `example_metric_study` on " +
                       std::to_string(shapes.size()) + " shapes.\n";
    text += "\n## Every shape against itself, then against itself rotated, scaled and moved\n\n" +
            to_markdown(eval::self_evaluation(shapes, eval::PairSettings()));
    const eval::MistakeResults mistakes = eval::evaluate_mistakes(shapes);
    text += "\n## Mistakes made on purpose\n\nZero means below 0.001 of the box.\n\n" +
            to_markdown(eval::sensitivity(mistakes));
    text += "\n## The same pairs under the public conventions\n\nMeans over shapes.\n\n" +
            to_markdown(eval::conventions(mistakes));
    text += "\n## Broken and degenerate predictions\n\nThe ground truth is " + shapes[0].id + ".\n\n" +
            to_markdown(eval::degenerate_inputs(shapes[0]));
    write_file_atomically(argv[2], text);
  } catch (const Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
  return 0;
}
