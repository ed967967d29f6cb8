"""What drives, bearings, wind and air do to a mount that stands right: their part of `scenario`.

In SI. All of it is off by default; docs/mount_effects.md has the sizes of good and bad instruments.
"""

from dataclasses import dataclass

from .scenario_fields import choice, number


@dataclass(frozen=True)
class Drive:
    """The servo and the friction of one axis.

    A position loop of finite gain lags behind a demand that moves: by rate / gain (velocity error
    of a type-1 servo; W. Gawronski, IPN Progress Report 42-159, 2004, for antennas and telescopes).
    Where static friction exceeds the sliding one, the axis sticks until the drive has wound up, and
    slips: the slip and the rate below which that happens as of B. Armstrong-Helouvry 1990, Proc.
    IEEE ICRA, 1377 (Stribeck friction); a telescope so measured: that of ARIES, 50/80 cm, LuGre.

    Attributes
    ----------
    gain : float
        Velocity constant of the position loop, rad/s a rad; 0: ideal. About 2 pi times the
        bandwidth, which is 1 to 3 Hz (L. Zago 1995, thesis EPFL 1394, for ESO's telescopes).
    feed_forward : float
        Part of the demanded rate that is fed forward, so that only the rest makes a lag.
    stick : float
        How far the axis slips at once, rad.
    stick_rate : float
        It slides smoothly at rates well above this (Stribeck), rad/s.
    """

    gain: float = number(0.0, 'per_s', 0.0, 1000.0)
    feed_forward: float = number(0.0, 'percent', 0.0, 100.0)
    stick: float = number(0.0, 'arcsec', 0.0, 600.0)
    stick_rate: float = number(20.0, 'arcsec_per_s', 1e-3, 36000.0)


@dataclass(frozen=True)
class Coupling:
    """The shaft coupling between an axis and its incremental encoder.

    Friction in the encoder's bearing and seal twists it against the motion. After a reversal the
    twist goes over to the other side along the way (P. R. Dahl 1968, Aerospace Corp. TOR-158).

    Attributes
    ----------
    wind_up : float
        Twist when the axis has moved far: friction torque over torsional rigidity, rad. 0.01 Nm
        over 500 Nm/rad is 4".
    distance : float
        Way over which all but 1/e of a change has been made, rad.
    """

    wind_up: float = number(0.0, 'arcsec', 0.0, 3600.0)
    distance: float = number(0.5, 'deg', 1e-3, 90.0)


@dataclass(frozen=True)
class Runout:
    """Non-repetitive run-out of the azimuth bearing: a lean that no turn of the axis repeats.

    Balls that are not alike go round with their cage, (1 - d / D cos a) / 2 times a turn of the
    axis for balls of diameter d on a circle D at contact angle a (T. A. Harris, Rolling Bearing
    Analysis, ch. 25), and slip. ISO 230-7 and ASME B89.3.4 call it asynchronous error motion.

    Attributes
    ----------
    per_turn : float
        Periods in a turn of the axis: 0.4 to 0.45 for the cage, that times the number of balls
        for their passing.
    lean : {'forward', 'left'}
        As for `Wobble`.
    amplitude, phase : float
        rad.
    slip : float
        1-sigma by which the balls are ahead or behind in phase, rad,
    slip_time : float
        and the time after which they have forgotten it, s.
    """

    per_turn: float = number(0.43, '', 0.01, 1000.0)
    lean: str = choice('forward', 'forward', 'left')
    amplitude: float = number(0.0, 'arcsec', -3600.0, 3600.0)
    phase: float = number(0.0, 'deg', -360.0, 360.0)
    slip: float = number(0.0, 'deg', 0.0, 3600.0)
    slip_time: float = number(0.5, 'h', 1e-3, 1000.0)


@dataclass(frozen=True)
class Wind:
    """Wind on the tube: it bends the structure, which no encoder sees, and turns the axes.

    The force goes with the dynamic pressure, so with speed^2, and with how far across the tube the
    wind blows; its fluctuation is 2 `intensity` of it with von Karman's spectrum, low-passed by the
    size of the structure (L. Zago 1995, thesis EPFL 1394, ch. 2 and 4; D. G. MacMynowski and
    T. Andersen 2010, Appl. Opt. 49, 625). The servo takes up what is slower than itself.

    Attributes
    ----------
    speed : float
        Mean speed, m/s.
    origin : float
        Azimuth from which it blows, rad.
    intensity : float
        Turbulence intensity: 1-sigma of the speed over its mean.
    length : float
        Of the largest eddies, m.
    size : float
        Of what the wind blows at, m; smaller eddies cancel on it.
    shelter : float
        Part of the pressure that the building takes away where the tube looks down the wind;
        against the wind nothing, across half of it.
    bending : float
        Of the tube by a steady 10 m/s across it, rad.
    shake : float
        By how much such a wind turns an axis before the servo has answered, rad.
    bandwidth : float
        Of the servo, Hz.
    """

    speed: float = number(0.0, 'm_s', 0.0, 60.0)
    origin: float = number(0.0, 'deg', -360.0, 360.0)
    intensity: float = number(15.0, 'percent', 0.0, 100.0)
    length: float = number(80.0, 'm', 0.1, 2000.0)
    size: float = number(1.0, 'm', 0.01, 100.0)
    shelter: float = number(50.0, 'percent', 0.0, 100.0)
    bending: float = number(0.0, 'arcsec', 0.0, 600.0)
    shake: float = number(0.0, 'arcsec', 0.0, 600.0)
    bandwidth: float = number(2.0, 'hz', 1e-3, 1000.0)


@dataclass(frozen=True)
class Seeing:
    """What turbulence and light leave of a star's place, beside `Camera.star_noise`.

    Image motion of one axis, (0.182 (D/r0)^(5/3))^(1/2) lambda/D for an instant (Noll 1976, J.
    Opt. Soc. Am. 66, 207; as a measure of seeing: H. M. Martin 1987, PASP 99, 1360), goes down
    with the root of the exposure beyond `motion_time`. Photons: the width of the image over the
    root of their number, and the background's (K. A. Winick 1986, J. Opt. Soc. Am. A 3, 1809).

    Attributes
    ----------
    fwhm : float
        Of the seeing at the zenith, rad; it goes with airmass^0.6.
    aperture : float
        Of the telescope, m.
    motion_time : float
        After this the image has moved elsewhere, s: size of the largest eddies over the wind.
    star_rate : float
        Electrons a second of a star of magnitude 0 above the air; 0: no photon noise.
    extinction : float
        Magnitudes an airmass.
    sky : float
        Magnitude of a square arcsecond of the sky.
    """

    fwhm: float = number(0.0, 'arcsec', 0.0, 60.0)
    aperture: float = number(0.2, 'm', 0.01, 50.0)
    motion_time: float = number(1.0, 's', 1e-3, 100.0)
    star_rate: float = number(0.0, 'ke_per_s', 0.0, 1e9)
    extinction: float = number(0.2, '', 0.0, 5.0)
    sky: float = number(20.0, '', 0.0, 25.0)


@dataclass(frozen=True)
class AirLayers:
    """Layers of the air that are not level, and not for long: refraction wanders.

    They lean by a vector of two components that follow an AR(1) process in time; refraction is
    about their normal. So a star is displaced by R0 lean / sin^2 E in elevation and by
    R0 lean / sin E across, R0 being 55" (C. Hirt 2006, Astron. Astrophys. 459, 283, finds
    zenith refraction of 0.05-0.2"; M. S. Taylor et al. 2013, Astron. J. 145, 82: some tenths of
    an arcsecond over ten minutes, from structures below 60 m).

    Attributes
    ----------
    lean : float
        1-sigma of each component, rad; 1 deg displaces a star in the zenith by 1".
    correlation_time : float
        s.
    """

    lean: float = number(0.0, 'deg', 0.0, 10.0)
    correlation_time: float = number(10.0, 'min', 0.01, 10000.0)
