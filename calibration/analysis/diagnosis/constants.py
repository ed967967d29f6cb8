"""Numbers that the diagnosis rests on, each with its reason; of weights: `estimation.robust`."""

#: candidates within this BIC of the best are one set: from 6 on the evidence for one of two is
#: "strong" (Kass and Raftery 1995, section 3.2)
SET_WIDTH = 6.0
#: squared cosine from which two groups are the same curve: what they do not share is then below
#: SET_WIDTH, 0.02 lambda^2 < 6, up to an effect of lambda = 17 times its noise
ALIAS = 0.98
#: part of a (scaled) column that must remain beyond the model: below it the coefficient's sigma is
#: 50 times that of the column alone, and what is told rests on the second order
DISTINCT = 0.02
#: eigenvalues of a normal matrix of unit columns below this part of the largest are rounding: its
#: entries are good to some 1e-13 of 1e5 rows
EIGEN = 1e-10
#: times the scatter of the others from where a night held out is bad: of 67 nights of one
#: telescope in six years, seven terms fitted to each, 61 leave less than 1.5 times their median
#: and 64 less than 2 times
BAD_NIGHT = 2.0
#: standard errors within which a fitted size agrees with one that physics fixes
AGREES = 3.0
#: weight above which a row counts: Hampel's is 0.05 at 20.5 standard deviations
LIVE = 0.05
#: parts of the family-wise error that the dictionary and the curves may use. Their alarms overlap
#: and the tests are conservative: together they stay below it (measured, benchmarks/diagnosis.py).
DICTIONARY_SHARE = 0.85
CURVE_SHARE = 0.35
#: rows with which a group's variance is moderated toward that of its axis: of a group on 100 rows
#: its own counts half. The level does not hang on it (noise as 1/sin^2 E, alpha 0.05, false alarms
#: of 60 nights with 1, 100, 1e6: 30 stars 1, 3, 1; 200 stars 4, 5, 4).
PRIOR = 100.0
#: an effect may be bought only with rows enough: half as many free values as it has coefficients
ROWS_PER_COLUMN = 1.5
#: effects that a search adds, at most
MOST_EFFECTS = 20
#: sign flips behind each p: of a p of 0.01, 1999 leave 0.002 of counting error
FLIPS = 1999
#: flips inside a fold, where a p is only compared with alpha
NESTED_FLIPS = 499
#: normal standard deviations above the largest of the first flips from where no flip will come near
FAR = 2.5
#: folds of the cross-validation; of `LONG` rows on, where each takes long, at most `FEW_FOLDS`
FOLDS, FEW_FOLDS, LONG = 10, 5, 1500
#: runs from which on whole runs are left out: with fewer, a fold is a third of all there is
RUNS = 4
#: rows that a diagnosis looks at, and of each run at least, where there are more: time and memory
#: grow with them
MOST_ROWS, OF_RUN = 5000, 30
#: a candidate whose score a wander swells by more (variance) is one that it can be mistaken for;
#: with up to a fifth more a p of 0.01 is one of 0.02
SLOW = 1.2
#: independent tests that the likelihood ratio of a wander counts as, over both axes, the memories
#: and sizes that are tried: of 500 nights of noise without memory each, N = 30, 60, 200, its chance
#: is 0.01 or less in 0.8, 0.2 and 1.0 %, 0.05 or less in 4.0, 3.4 and 3.8 %
WANDER_TESTS = 6.0
#: searches, each without what the ones before have given up, at most
ROUNDS = 4
#: partitions into folds over which the cross-validated RMS is a mean: at least and at most; as many
#: as bring its standard error below the part `SPREAD`. A few that agree by luck ended it too early:
#: over 20 seeds the figure of 105 rows (8 m) went from 1.02 to 1.10", 8 %, with three at least, by
#: 6 % with five
PARTITIONS, MOST_PARTITIONS, SPREAD = 10, 16, 0.01
#: rows from which on few partitions do, a row more or less in a fold changes little: so many
MANY, FEW_PARTITIONS = 250, 3
#: correlation of neighbours below which a candidate's score is swollen by less than `SLOW`: by
#: less than 1 + 2 UNLIKE (1 + r + r^2 ...) of rows that share r = 0.6, and of longer memories
#: those that pass the test are tested again
UNLIKE = 0.05
#: nights simulated with a wander, of which 1 in 100 is as extreme as a p of 0.01
NIGHTS = 199
#: share of these nights that is taken as the tail
TAIL = 0.2
#: 2 ln of a likelihood ratio below which no effect is beyond a wander at a p of 0.01: what the
#: largest passes in 1 of 100 simulated nights was 12.2 to 23.9 (71 wandering nights of 30 to 200
#: rows)
RATIO_WORTH_IT = 12.0
#: part of the signal of a found effect that a rival must take up alone to be tried with companions
#: of its own (correlation 0.9): what others leave to companions is most of an effect of its own
NEAR = 0.8
#: part of the largest gain of a run below which the rivals of an effect are not tried so
LARGE = 0.1
#: rivals that are tried so in one run, at most: each is a search of its own
MOST_TRIED = 4
