// Multiple importance sampling: what a sample of one technique weighs where another might have drawn it as well.
//
// Veach & Guibas 1995, "Optimally Combining Sampling Techniques for Monte Carlo Rendering": any weights that add
// up to 1 over the techniques leave the estimate unbiased. Densities are per steradian, all of them.
#ifndef LIB_MIS
#define LIB_MIS

#define HEURISTIC_BALANCE 0
#define HEURISTIC_POWER 1
#ifndef HEURISTIC
#define HEURISTIC HEURISTIC_BALANCE
#endif

// Of one sample each of two techniques: what that weighs which was drawn with density `own`. By the quotient, whose square
// stays a number where densities' squares do not.
float mis_weight(float own, float other)
{
    float quotient = other / own;
#if HEURISTIC == HEURISTIC_POWER
    quotient *= quotient;
#endif
    return 1.0 / (1.0 + quotient);
}

#endif
