#pragma once
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/io/rigs/shape_source.h"

namespace anigen::io {

/// One id of a split file.
struct SplitLine {
  std::string id;
  std::size_t line;  ///< from 1
};

/// The ids of a split file, one a line; blanks around them, empty lines and lines starting with '#' are skipped. May be
/// none: a data set writes an empty list of what it cannot use. @throws InputError when the file is missing
std::vector<SplitLine> split_lines(const std::filesystem::path& file);

/// The same for a list that somebody asks to be evaluated. @throws InputError also when it names none
std::vector<SplitLine> read_split(const std::filesystem::path& file);

/// The source's ids that the split files name, each once, in the source's order; all of them without split files.
/// A line may also give one of a shape's short_names, where no other shape has it.
/// @param most only so many of the first ids, as the split files order them; 0: all
/// @throws InputError naming the line for an id that the source does not have
std::vector<std::string> select_ids(const ShapeSource& source, const std::vector<std::filesystem::path>& splits,
                                    std::size_t most = 0);

}  // namespace anigen::io
