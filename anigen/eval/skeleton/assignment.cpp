#include "anigen/eval/skeleton/assignment.h"

#include <algorithm>
#include <limits>

#include "anigen/core/error.h"

namespace anigen::eval {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// rows ≤ columns. @return the row of each column, -1 for a free one
std::vector<int> rows_of_columns(const RowMajor& cost) {
  const Eigen::Index rows = cost.rows(), columns = cost.cols();
  const double infinity = std::numeric_limits<double>::infinity();
  Eigen::VectorXd row_potential = Eigen::VectorXd::Zero(rows), column_potential = Eigen::VectorXd::Zero(columns);
  std::vector<int> owner(static_cast<std::size_t>(columns), -1), previous(static_cast<std::size_t>(columns));
  std::vector<char> done(static_cast<std::size_t>(columns));
  std::vector<Eigen::Index> finished;
  Eigen::VectorXd distance(columns);
  for (Eigen::Index start = 0; start < rows; ++start) {
    // Dijkstra over columns by reduced cost, from the unmatched row to the nearest free column.
    std::fill(done.begin(), done.end(), 0);
    finished.clear();
    distance.setConstant(infinity);
    Eigen::Index row = start, sink = -1;
    int from = -1;
    double reached = 0;
    while (sink < 0) {
      Eigen::Index next = -1;
      double least = infinity;
      for (Eigen::Index c = 0; c < columns; ++c) {
        const auto at = static_cast<std::size_t>(c);
        if (done[at]) continue;
        const double through = reached + cost(row, c) - row_potential[row] - column_potential[c];
        if (through < distance[c]) {
          distance[c] = through;
          previous[at] = from;
        }
        // A free column of the same distance ends the search at once.
        if (distance[c] < least || (next >= 0 && distance[c] == least && owner[at] < 0)) {
          least = distance[c];
          next = c;
        }
      }
      // Rows are not more than columns, so only a cost that is not finite leaves nothing to go on with.
      if (next < 0) throw InputError("", "joint matching", "a cost is not finite");
      done[static_cast<std::size_t>(next)] = 1;
      reached = least;
      from = static_cast<int>(next);
      if (owner[static_cast<std::size_t>(next)] < 0) {
        sink = next;
      } else {
        finished.push_back(next);
        row = owner[static_cast<std::size_t>(next)];
      }
    }
    row_potential[start] += reached;
    for (const Eigen::Index c : finished) {
      row_potential[owner[static_cast<std::size_t>(c)]] += reached - distance[c];
      column_potential[c] -= reached - distance[c];
    }
    for (Eigen::Index c = sink; c >= 0;) {
      const int before = previous[static_cast<std::size_t>(c)];
      owner[static_cast<std::size_t>(c)] =
          before < 0 ? static_cast<int>(start) : owner[static_cast<std::size_t>(before)];
      c = before;
    }
  }
  return owner;
}

}  // namespace

std::vector<int> assign(const Eigen::MatrixXd& cost) {
  if (static_cast<double>(cost.rows()) * static_cast<double>(cost.cols()) > kLargestAssignment)
    throw InputError("", "joint matching", "too many joints on both sides to be matched one to one");
  if (!cost.allFinite()) throw InputError("", "joint matching", "a cost is not finite");
  std::vector<int> result(static_cast<std::size_t>(cost.rows()), -1);
  if (cost.size() == 0) return result;
  if (cost.rows() > cost.cols()) return rows_of_columns(cost.transpose());  // columns of rows, seen from the other side
  const std::vector<int> owner = rows_of_columns(cost);
  for (std::size_t c = 0; c < owner.size(); ++c) {
    if (owner[c] >= 0) result[static_cast<std::size_t>(owner[c])] = static_cast<int>(c);
  }
  return result;
}

}  // namespace anigen::eval
