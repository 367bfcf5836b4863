// Could chance alone have found that many inliers?
#pragma once

#include <cstddef>
#include <limits>

namespace rilievo {

/// Natural logarithm of the expected number of models that unrelated pairs would support as well: log(tests * P(X >=
/// k)), X binomial over the n - p items outside the sample, k = inliers - p, each agreeing by chance with
/// `probability`. +infinity when there is nothing to test. After Moisan & Stival, IJCV 57(3), 2004 (number of false
/// alarms), with the tests made in the place of all that are possible. O(n), or O(1)
/// where Chernoff's bound of the tail is below `enough`: then that bound, from above, is the answer.
double LogFalseAlarms(std::size_t inliers, std::size_t n, std::size_t sample_size, double probability, double tests,
                      double enough = -std::numeric_limits<double>::infinity());

}  // namespace rilievo
