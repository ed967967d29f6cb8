"""What a person should know of a term's value."""

#: standard errors from where a value is no zero
_SURE = 3.0


def notes_of_terms(terms):
    """Notes on values that no mount should have.

    Parameters
    ----------
    terms : iterable of dict
        ``name``, ``value_arcsec``, ``sigma_arcsec``.

    Returns
    -------
    list of str
    """
    return [f'TF is negative (−{abs(row["value_arcsec"]):.1f} ± {row["sigma_arcsec"]:.1f} arcsec), '
            'as if the tube bent up. Usual reasons: the refraction was taken off twice or too much '
            '(TX or TX3 fits better then); an elevation encoder that errs once a turn; or mount '
            'and catalogue exchanged in the file, which turns every sign.'
            for row in terms if row['name'] == 'TF' and row.get('sigma_arcsec')
            and row['value_arcsec'] < -_SURE * row['sigma_arcsec']]
