"""From an estimate to the best asset: ranking, refinement, search, recognition, and results for programs and people.

`estimate.py` is the one workflow that the command line, the app and the HTTP API call: recognise the generator,
estimate, rank or search on, and report a picture that is out of distribution. A picture is cut out once, and
`inverters.py` loads each network once, when it is first used. An `Estimate` is plain data, so it can be stored and
sent; ranking and searching take the inverter, which builds the meshes.

Agreement is a number from 0 to 1 that compares a render of a candidate with the picture: the mean of the overlap of
the silhouettes and of the nearness of the lines, or the lines alone where a silhouette cannot be trusted. Misfit is
1 minus the agreement of the best candidate. Ranking minimises the expected distance to the truth and does not
follow the highest agreement, because a wrong shape can look right from a camera that may move: agreement, minus a
penalty for what the network did not expect, gives each candidate a probability, and the candidate that is nearest
to all others by these probabilities comes first. The search first applies corrections of the network, which are the
difference between its readings of the picture and of a render with known parameters; an evolution strategy (CMA-ES)
and changes of choices continue from there. Cameras are optimised between builds, because a render takes much less
time than a build. A linear classifier on the encoder of the chair's checkpoint recognises the generators that ship
and must be fitted again when that encoder changes; for other generators each estimator ranks a few candidates, and
a softmax over the best agreements gives the probabilities. A picture is reported as out of distribution by the mean
of the misfit and of 1 minus the classifier's probability, because each of the two errs where the other does not.
MCMC, random search and CMA-ES are functions of their seed and of the scores so far, so the log of scores is the
whole state of a killed search, and nothing is pickled.
"""
