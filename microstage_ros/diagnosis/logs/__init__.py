"""Diagnosis of logs without a model file: the healthy machine is learned from its baseline, changes are named from the
catalogue.

Order of a diagnosis: `motion` tells how each log moves; `coordinates` reduces every repetition to means over cells of
like motion and to amplitudes of ripple; `spread` learns how much a healthy machine differs from itself; `effects` says
how each cause of the catalogue would show in those coordinates; `decide` names what stands out, its rivals, and what
cannot show.
"""
