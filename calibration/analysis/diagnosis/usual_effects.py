"""Effects that many mounts have, as terms: what a misfit may be in place of mistaken columns."""

_ALTAZ = (('ECES',), ('TX',), ('HECE2', 'HESE2'), ('ACEC', 'ACES'), ('HACA2', 'HASA2'),
          ('HECA', 'HESA'), ('HECA2', 'HESA2'), ('HVCA2', 'HVSA2'))
_HADEC = (('HZCZ',), ('TX',), ('HDCD2', 'HDSD2'), ('HCEC', 'HCES'), ('HHCH2', 'HHSH2'),
          ('HDCH', 'HDSH'), ('HDCH2', 'HDSH2'), ('HPCH2', 'HPSH2'), ('DAF',))
#: by the kind of mount
USUAL = {'altaz': _ALTAZ, 'equatorial': _HADEC, 'german': _HADEC, 'free': (('TX',), ('HZCZ',))}
