#include "anigen/fields/dual_vertices.h"

#include "anigen/fields/dual_vertex_kernels.h"
#include "anigen/fields/flexicubes_tables.h"
#include "anigen/fields/grid_sets.h"

namespace anigen::fields {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

// What the kernels need of a topology, as tensors that a backward pass can keep.
enum SavedTensor : std::size_t { kRows, kAlpha, kBeta, kCorners, kCornerSources, kCases, kFirstDual, kFirstCrossing };

template <typename T>
kernels::DualCubes<T> dual_cubes(const variable_list& saved) {
  kernels::DualCubes<T> problem;
  problem.cubes = saved[kCases].size(0);
  problem.channels = saved[kRows].size(1) - 1;
  problem.rows = saved[kRows].data_ptr<T>();
  problem.alpha = saved[kAlpha].data_ptr<T>();
  problem.beta = saved[kBeta].data_ptr<T>();
  problem.corners = saved[kCorners].data_ptr<std::int32_t>();
  problem.cases = saved[kCases].data_ptr<std::uint8_t>();
  problem.first_dual = saved[kFirstDual].data_ptr<std::int32_t>();
  problem.first_crossing = saved[kFirstCrossing].data_ptr<std::int32_t>();
  return problem;
}

template <typename T>
void run_forward(const variable_list& saved, const Tensor& values, const Tensor& deviation) {
  kernels::dual_vertices_forward<T>(dual_cubes<T>(saved), values.data_ptr<T>(),
                                    deviation.defined() ? deviation.data_ptr<T>() : nullptr);
}

template <typename T>
void run_backward(const variable_list& saved, const Tensor& d_values, const Tensor& d_deviation,
                  const Tensor& d_corners, const Tensor& d_alpha, const Tensor& d_beta) {
  kernels::dual_vertices_backward<T>(dual_cubes<T>(saved), d_values.data_ptr<T>(),
                                     d_deviation.defined() ? d_deviation.data_ptr<T>() : nullptr,
                                     d_corners.data_ptr<T>(), d_alpha.data_ptr<T>(), d_beta.data_ptr<T>());
}

// Returns the values and, when asked for, the deviation.
class DualVertexFunction : public torch::autograd::Function<DualVertexFunction> {
 public:
  static variable_list forward(AutogradContext* context, const Tensor& rows, const Tensor& alpha, const Tensor& beta,
                               const Tensor& corners, const Tensor& corner_sources, const Tensor& cases,
                               const Tensor& first_dual, const Tensor& first_crossing, std::int64_t duals,
                               std::int64_t crossings, bool with_deviation) {
    RECORD_USER_SCOPE("surface extraction: dual vertices");
    const variable_list saved = {rows, alpha, beta, corners, corner_sources, cases, first_dual, first_crossing};
    context->save_for_backward(saved);
    const Tensor values = torch::empty({duals, rows.size(1) - 1}, rows.options());
    const Tensor deviation = with_deviation ? torch::empty({crossings}, rows.options()) : Tensor();
    if (rows.scalar_type() == torch::kFloat64) {
      run_forward<double>(saved, values, deviation);
    } else {
      run_forward<float>(saved, values, deviation);
    }
    return with_deviation ? variable_list{values, deviation} : variable_list{values};
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("surface extraction: dual vertices");
    TORCH_CHECK(!at::GradMode::is_enabled(), "dual vertices can be differentiated once only");
    const variable_list saved = context->get_saved_variables();
    const Tensor& rows = saved[kRows];
    const Tensor d_values = gradients[0].contiguous();
    const Tensor d_deviation = gradients.size() > 1 ? gradients[1].contiguous() : Tensor();
    const Tensor d_corners = torch::empty({saved[kCorners].size(0), kCubeCorners, rows.size(1)}, rows.options());
    const Tensor d_alpha = torch::empty(saved[kAlpha].sizes(), rows.options());
    const Tensor d_beta = torch::empty(saved[kBeta].sizes(), rows.options());
    if (rows.scalar_type() == torch::kFloat64) {
      run_backward<double>(saved, d_values, d_deviation, d_corners, d_alpha, d_beta);
    } else {
      run_backward<float>(saved, d_values, d_deviation, d_corners, d_alpha, d_beta);
    }
    const RowLinks links{saved[kCorners].reshape({-1}), saved[kCornerSources]};
    variable_list result(11);
    result[0] = sum_rows(d_corners, links);
    result[1] = d_alpha;
    result[2] = d_beta;
    return result;
  }
};

}  // namespace

DualVertices dual_vertices(const Tensor& rows, const Tensor& alpha, const Tensor& beta, const DualTopology& topology,
                           bool with_deviation) {
  TORCH_CHECK(rows.dim() == 2 && rows.size(0) == topology.vertex_places.size(0) && rows.size(1) >= 4,
              "values at grid vertices ", rows.sizes(), " for ", topology.vertex_places.size(0), " vertices");
  if (!rows.is_cpu()) return tensor_dual_vertices(rows, alpha, beta, topology, with_deviation);
  const variable_list found = DualVertexFunction::apply(
      rows.contiguous(), alpha.contiguous(), beta.contiguous(), topology.corners, topology.corner_sources,
      topology.cases, topology.first_dual, topology.first_crossing, topology.duals, topology.crossings, with_deviation);
  return {found[0], with_deviation ? found[1] : Tensor()};
}

}  // namespace anigen::fields
