"""The types of what many mechanism files do not have: they are imported and built only for those that do."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from mbd_sim.mechanism_file.schema.later import ImportedLater

if TYPE_CHECKING:
    from mbd_sim.mechanism_file.schema.actuator_schema import AnyActuatorSpec
    from mbd_sim.mechanism_file.schema.constraint_schema import AnyConstraintSpec
    from mbd_sim.mechanism_file.schema.contact_schema import ContactSpec
    from mbd_sim.mechanism_file.schema.drive_schema import AngleDrive, LengthDrive
    from mbd_sim.mechanism_file.schema.force_schema import AnyForceSpec
    from mbd_sim.mechanism_file.schema.law_schema import (
        ForceCurveSpec,
        LinearFrictionSpec,
        LinearPowerSpec,
        TorqueCurveSpec,
        TorsionFrictionSpec,
        TorsionPowerSpec,
    )
    from mbd_sim.mechanism_file.schema.sensor_schema import AnySensorSpec, Seed
    from mbd_sim.mechanism_file.schema.shape_schema import AnyShapeSpec
    from mbd_sim.mechanism_file.schema.table_schema import TableSpec
    from mbd_sim.mechanism_file.schema.wheeled_base_schema import AnyBaseSpec
else:
    AnyActuatorSpec = Annotated[Any, ImportedLater("actuator_schema", "AnyActuatorSpec")]
    AnyConstraintSpec = Annotated[Any, ImportedLater("constraint_schema", "AnyConstraintSpec")]
    ContactSpec = Annotated[Any, ImportedLater("contact_schema", "ContactSpec")]
    AngleDrive = Annotated[Any, ImportedLater("drive_schema", "AngleDrive")]
    LengthDrive = Annotated[Any, ImportedLater("drive_schema", "LengthDrive")]
    AnyForceSpec = Annotated[Any, ImportedLater("force_schema", "AnyForceSpec")]
    ForceCurveSpec = Annotated[Any, ImportedLater("law_schema", "ForceCurveSpec")]
    LinearFrictionSpec = Annotated[Any, ImportedLater("law_schema", "LinearFrictionSpec")]
    LinearPowerSpec = Annotated[Any, ImportedLater("law_schema", "LinearPowerSpec")]
    TorqueCurveSpec = Annotated[Any, ImportedLater("law_schema", "TorqueCurveSpec")]
    TorsionFrictionSpec = Annotated[Any, ImportedLater("law_schema", "TorsionFrictionSpec")]
    TorsionPowerSpec = Annotated[Any, ImportedLater("law_schema", "TorsionPowerSpec")]
    AnySensorSpec = Annotated[Any, ImportedLater("sensor_schema", "AnySensorSpec")]
    Seed = Annotated[Any, ImportedLater("sensor_schema", "Seed")]
    AnyShapeSpec = Annotated[Any, ImportedLater("shape_schema", "AnyShapeSpec")]
    TableSpec = Annotated[Any, ImportedLater("table_schema", "TableSpec")]
    AnyBaseSpec = Annotated[Any, ImportedLater("wheeled_base_schema", "AnyBaseSpec")]

__all__ = [
    "AngleDrive",
    "AnyActuatorSpec",
    "AnyBaseSpec",
    "AnyConstraintSpec",
    "AnyForceSpec",
    "AnySensorSpec",
    "AnyShapeSpec",
    "ContactSpec",
    "ForceCurveSpec",
    "LengthDrive",
    "LinearFrictionSpec",
    "LinearPowerSpec",
    "Seed",
    "TableSpec",
    "TorqueCurveSpec",
    "TorsionFrictionSpec",
    "TorsionPowerSpec",
]
